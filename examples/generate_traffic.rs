//! Writes generated events as CSV, one step a row, in the columns of the `headway` preset:
//! `cargo run --release --example generate_traffic -- 300 42 > events.csv` (events per regime, seed).

use std::error::Error;
use std::io::{BufWriter, Write};

use headway::car_following::{TrafficRegime, TrafficSettings, generate};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let events: usize = arguments.next().unwrap_or_else(|| "300".to_owned()).parse()?;
    let seed: u64 = arguments.next().unwrap_or_else(|| "42".to_owned()).parse()?;
    let mut out = BufWriter::new(std::io::stdout().lock());
    writeln!(out, "event_id,source,run,regime,t,spacing_m,follower_speed_mps,leader_speed_mps")?;
    for regime in TrafficRegime::ALL {
        for generated in generate(regime, seed, events, &TrafficSettings::default()) {
            let event = &generated.event;
            for step in 0..event.steps() {
                writeln!(
                    out,
                    "{},{},{},{},{:.3},{},{},{}",
                    generated.event_id,
                    generated.source,
                    generated.run,
                    regime.as_str(),
                    step as f64 * event.dt_s(),
                    event.spacing_m()[step],
                    event.follower_speed_mps()[step],
                    event.leader_speed_mps()[step],
                )?;
            }
        }
    }
    out.flush()?;
    Ok(())
}
