//! Writes generated events as CSV, one step a row, in the columns of the `headway` preset:
//! `cargo run --release --example generate_traffic -- fast 300 42 > fast.csv` (regime, events, seed).

use std::error::Error;
use std::io::{BufWriter, Write};

use headway::car_following::{TrafficRegime, TrafficSettings, generate};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [regime, events, seed] = arguments.as_slice() else {
        return Err("three arguments, please: fast, middle or slow; the number of events; the seed".into());
    };
    let regime = TrafficRegime::ALL
        .into_iter()
        .find(|known| known.as_str() == regime)
        .ok_or_else(|| format!("there is no regime {regime}: it is fast, middle or slow"))?;
    let mut out = BufWriter::new(std::io::stdout().lock());
    writeln!(out, "event_id,source,run,t,spacing_m,follower_speed_mps,leader_speed_mps")?;
    for generated in generate(regime, seed.parse()?, events.parse()?, &TrafficSettings::default()) {
        let (name, source, run, event) = (&generated.event_id, &generated.source, &generated.run, &generated.event);
        let states = event.spacing_m().iter().zip(event.follower_speed_mps()).zip(event.leader_speed_mps());
        for (step, ((spacing, follower), leader)) in states.enumerate() {
            let t = step as f64 * event.dt_s();
            writeln!(out, "{name},{source},{run},{t:.3},{spacing},{follower},{leader}")?;
        }
    }
    out.flush()?;
    Ok(())
}
