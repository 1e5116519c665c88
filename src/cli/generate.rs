//! `headway generate`: made-up events, to try things with.

use std::fmt::Write as _;
use std::io::{BufWriter, Write};

use clap::{Args, ValueEnum};

use crate::car_following::{GeneratedEvent, TrafficRegime, TrafficSettings, generate};

/// What `headway generate` can be told.
#[derive(Debug, Args)]
pub(super) struct GenerateArguments {
    /// Kind of traffic
    #[arg(value_name = "REGIME")]
    regime: Named,
    /// How many events
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    events: u32,
    /// Of every random choice: the same seed makes the same events
    #[arg(long, value_name = "N", default_value_t = 42)]
    seed: u64,
}

/// A regime by its name.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Named {
    /// Motorway cruising: followers' mean speeds of 13.6 to 25 m/s
    Fast,
    /// Arterial roads, braking and accelerating in turn: mean speeds of 8.6 to 12.4 m/s
    Middle,
    /// Congestion, down to a standstill: mean speeds of 1 to 7.4 m/s
    Slow,
}

impl From<Named> for TrafficRegime {
    fn from(named: Named) -> Self {
        match named {
            Named::Fast => Self::Fast,
            Named::Middle => Self::Middle,
            Named::Slow => Self::Slow,
        }
    }
}

/// Prints the events as CSV, one step a row, in the columns of the preset `headway`.
pub(super) fn run(arguments: &GenerateArguments) -> anyhow::Result<()> {
    let GenerateArguments { regime, events, seed } = arguments;
    let mut out = BufWriter::new(std::io::stdout().lock());
    writeln!(out, "event_id,source,run,t,spacing_m,follower_speed_mps,leader_speed_mps")?;
    for generated in generate((*regime).into(), *seed, *events as usize, &TrafficSettings::default()) {
        out.write_all(rows(&generated).as_bytes())?;
    }
    Ok(out.flush()?)
}

fn rows(generated: &GeneratedEvent) -> String {
    let (name, source, run, event) = (&generated.event_id, &generated.source, &generated.run, &generated.event);
    let states = event.spacing_m().iter().zip(event.follower_speed_mps()).zip(event.leader_speed_mps());
    let mut rows = String::new();
    for (step, ((spacing, follower), leader)) in states.enumerate() {
        let t = step as f64 * event.dt_s();
        let written = writeln!(rows, "{name},{source},{run},{t:.3},{spacing},{follower},{leader}");
        written.expect("a string takes what is written");
    }
    rows
}
