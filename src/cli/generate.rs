//! `headway generate`: made-up events, to try things with.

use std::io::{self, BufWriter, Write};

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::car_following::{GeneratedEvent, TrafficRegime, TrafficSettings, generate};

/// What `headway generate` can be told.
#[derive(Debug, Args)]
pub(super) struct GenerateArguments {
    /// Kind of traffic: motorway, arterial roads, congestion
    #[arg(value_name = "REGIME", value_parser = regimes())]
    regime: TrafficRegime,
    /// How many events
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    events: u32,
    /// Of every random choice: the same seed makes the same events
    #[arg(long, value_name = "N", default_value_t = 42)]
    seed: u64,
}

fn regimes() -> impl TypedValueParser<Value = TrafficRegime> {
    let names = TrafficRegime::ALL.map(TrafficRegime::as_str);
    PossibleValuesParser::new(names).map(|name| {
        let known = TrafficRegime::ALL.into_iter().find(|regime| regime.as_str() == name);
        known.expect("only names of regimes are possible")
    })
}

/// Prints the events as CSV, one step a row, in the columns of the preset `headway`.
pub(super) fn run(arguments: &GenerateArguments) -> anyhow::Result<()> {
    let GenerateArguments { regime, events, seed } = arguments;
    let mut out = BufWriter::new(io::stdout().lock());
    writeln!(out, "event_id,source,run,t,spacing_m,follower_speed_mps,leader_speed_mps")?;
    for generated in generate(*regime, *seed, *events as usize, &TrafficSettings::default()) {
        write_rows(&mut out, &generated)?;
    }
    Ok(out.flush()?)
}

fn write_rows(out: &mut impl Write, generated: &GeneratedEvent) -> io::Result<()> {
    let (name, source, run, event) = (&generated.event_id, &generated.source, &generated.run, &generated.event);
    let states = event.spacing_m().iter().zip(event.follower_speed_mps()).zip(event.leader_speed_mps());
    for (step, ((spacing, follower), leader)) in states.enumerate() {
        let t = step as f64 * event.dt_s();
        writeln!(out, "{name},{source},{run},{t:.3},{spacing},{follower},{leader}")?;
    }
    Ok(())
}
