//! `headway predict` and `headway simulate`: what a version would do, asked in the JSON of the interface.

use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use serde_json::{Value, json};

use super::asked::Asked;
use super::member::{number, text};
use super::service::Opened;
use super::table::table;

/// What `headway predict` can be told.
#[derive(Debug, Args)]
pub(super) struct PredictArguments {
    /// JSON: {"windows": […]}, an array of windows, or one window; - reads it from stdin
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// A version other than the one that serves
    #[arg(long, value_name = "NUMBER")]
    version: Option<u64>,
    #[command(flatten)]
    asked: Asked,
}

/// What `headway simulate` can be told.
#[derive(Debug, Args)]
pub(super) struct SimulateArguments {
    #[arg(
        value_name = "FILE",
        help = "JSON: {\"initial\": a window, \"leader_speed_mps\": […]}; - reads it from stdin"
    )]
    file: PathBuf,
    /// A version other than the one that serves
    #[arg(long, value_name = "NUMBER")]
    version: Option<u64>,
    /// Show one step of so many
    #[arg(long, value_name = "STEPS", default_value = "1", value_parser = clap::value_parser!(u64).range(1..))]
    every: u64,
    #[command(flatten)]
    asked: Asked,
}

/// The JSON in a file, or on stdin.
fn read(file: &Path) -> anyhow::Result<Value> {
    let shown = file.display();
    let text = if file == Path::new("-") {
        let mut text = String::new();
        std::io::stdin().read_to_string(&mut text).map(|_| text)
    } else {
        std::fs::read_to_string(file)
    };
    serde_json::from_str(&text.with_context(|| format!("cannot read {shown}"))?)
        .with_context(|| format!("{shown} is not JSON"))
}

fn ask(asked: &Asked, way: &str, mut wish: Value, version: Option<u64>) -> anyhow::Result<Value> {
    if let (Some(version), Some(wish)) = (version, wish.as_object_mut()) {
        wish.insert("version".to_owned(), json!(version));
    }
    asked.place.ask(Opened::Known, async |service| service.post(&asked.path(way), &wish).await)
}

/// Predicts the next acceleration of each window.
pub(super) fn predict(arguments: &PredictArguments) -> anyhow::Result<()> {
    let PredictArguments { file, version, asked } = arguments;
    let wish = match read(file)? {
        windows @ Value::Array(_) => json!({"windows": windows}),
        window if window.get("spacing_m").is_some() => json!({"windows": [window]}),
        wish => wish,
    };
    let answer = ask(asked, "/predict", wish, *version)?;
    asked.print(&answer, || {
        let predictions = answer["predictions"].as_array().map_or(&[][..], Vec::as_slice);
        let row = |(at, prediction): (usize, &Value)| {
            let [accel, raw] = ["accel_mps2", "raw_accel_mps2"].map(|member| number(&prediction[member], 4));
            vec![(at + 1).to_string(), accel, raw, text(&prediction["flags"])]
        };
        let rows = predictions.iter().enumerate().map(row).collect();
        let table = table(&["WINDOW", "ACCEL_MPS2", "RAW_ACCEL_MPS2", "FLAGS"], rows);
        format!("version {} of {}\n\n{table}", answer["version"], asked.model)
    })
}

/// Drives a follower behind a leader.
pub(super) fn simulate(arguments: &SimulateArguments) -> anyhow::Result<()> {
    let SimulateArguments { file, version, every, asked } = arguments;
    let answer = ask(asked, "/simulate", read(file)?, *version)?;
    asked.print(&answer, || {
        let steps = answer["spacing_m"].as_array().map_or(0, Vec::len);
        let every = usize::try_from(*every).unwrap_or(usize::MAX);
        let rows = (0..steps).step_by(every).map(|step| {
            let cells =
                ["spacing_m", "follower_speed_mps", "accel_mps2"].map(|member| number(&answer[member][step], 3));
            std::iter::once((step + 1).to_string()).chain(cells).collect()
        });
        let table = table(&["STEP", "SPACING_M", "SPEED_MPS", "ACCEL_MPS2"], rows.collect());
        let end = if answer["collided"] == true { "it collided" } else { "no collision" };
        let flags = text(&answer["flags"]);
        let flags = if flags.is_empty() { String::new() } else { format!("; flags: {flags}") };
        format!("version {} of {}\n\n{table}\n\n{end}{flags}", answer["version"], asked.model)
    })
}
