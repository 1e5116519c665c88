//! Running it on generated traffic.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use headway::car_following::{TrafficRegime, TrafficSettings, generate};
use serde_json::Value;

/// Small and quick: models worth nothing, in seconds.
pub(crate) const SMALL: [&str; 12] =
    ["--steps", "40", "--hidden", "4", "--epochs", "2", "--seeds", "1,2", "--set", "minibatch=8", "--resamples", "50"];

/// `headway reproduce` in `folder`, with a report in `out`.
pub(crate) fn reproduce(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    command.arg("reproduce").args(["--out", "out"]).args(arguments);
    command.current_dir(folder).env("RUST_BACKTRACE", "1").stdin(Stdio::null());
    command
}

/// What a run that did its work left in `out/report.json`.
#[track_caller]
pub(crate) fn report(folder: &Path, output: &Output) -> Value {
    assert!(output.status.success(), "{}", told(output));
    serde_json::from_slice(&fs::read(folder.join("out/report.json")).unwrap()).unwrap()
}

pub(crate) fn told(output: &Output) -> &str {
    std::str::from_utf8(&output.stderr).unwrap()
}

/// Generated events of each regime, in the columns that recordings come in; `change` may do something to the rows of one.
pub(crate) fn csv(events: usize, change: impl Fn(&str, usize) -> f64) -> String {
    let lengths = TrafficSettings { min_steps: 44, max_steps: 60, ..TrafficSettings::default() };
    let mut csv = "event_id,source,run,t,spacing,sv_speed,lv_speed\n".to_owned();
    for regime in TrafficRegime::ALL {
        for (number, drive) in generate(regime, 5, events, &lengths).into_iter().enumerate() {
            let (event, id) = (&drive.event, &drive.event_id);
            for step in 0..event.steps() {
                let spacing = f64::from(event.spacing_m()[step]) + change(id, step);
                let (follower, leader) = (event.follower_speed_mps()[step], event.leader_speed_mps()[step]);
                let (source, run, t) = (regime.as_str(), number / 2, step as f64 * event.dt_s());
                writeln!(csv, "{id},{source},{run},{t:.1},{spacing},{follower},{leader}").unwrap();
            }
        }
    }
    csv
}

/// A folder with `events.csv`.
pub(crate) fn folder(events: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("events.csv"), csv(events, |_, _| 0.0)).unwrap();
    folder
}
