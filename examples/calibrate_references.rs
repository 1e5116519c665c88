//! Calibrates the reference drivers on recorded events task by task, and drives them on the test events of the same task:
//! `cargo run --release --example calibrate_references -- SPLITS.csv FILE.parquet…`
//!
//! The splits name each event with its task and its part (`event_id,task,split`). Every event is cut to its first 150 steps and
//! simulated from step 10 on. Prints a table in Markdown, and the parameters found.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write;
use std::fs::File;
use std::ops::ControlFlow;
use std::time::Instant;

use headway::car_following::Event;
use headway::evaluation::{CalibrationSettings, Errors, calibrate, evaluate_reference};
use headway::formats::{BodyKind, Encoding, Format, FormatLimits, Preset, decode};
use headway::reference::ReferenceKind;

const STEPS: usize = 150;
const HORIZON: usize = 10;

/// The events of one task.
#[derive(Default)]
struct Task {
    train: Vec<Event>,
    test: Vec<Event>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((splits, files)) = arguments.split_first().filter(|(_, files)| !files.is_empty()) else {
        return Err("a file of splits and files of events, please".into());
    };
    let tasks = tasks(splits, files)?;
    let workers = rayon::ThreadPoolBuilder::new().build()?;
    let settings = CalibrationSettings::default();
    let mut table = String::from(
        "| task | driver | training events | spacing MSE there | test events | spacing MSE | published parameters' | \
         speed MSE | collided | calibrated in s |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let mut parameters = String::new();
    for (name, task) in &tasks {
        let train: Vec<&Event> = task.train.iter().collect();
        for kind in ReferenceKind::ALL {
            let started = Instant::now();
            let found = calibrate(kind, HORIZON, &train, &settings, &workers);
            let took_s = started.elapsed().as_secs_f64();
            let on_test = |driver| evaluate_reference(driver, HORIZON, &task.test, &workers);
            let (after, before) = (on_test(&found.driver), on_test(&kind.published()));
            writeln!(
                table,
                "| {name} | {} | {} | {:.2} | {} | {:.2} | {:.2} | {:.3} | {} | {took_s:.1} |",
                kind.as_str(),
                found.on.events,
                spacing_mse(&found.on),
                after.events,
                spacing_mse(&after),
                spacing_mse(&before),
                after.speed_sq / after.steps as f64,
                after.collisions,
            )?;
            let values: Vec<_> =
                found.driver.named_values().map(|(name, value)| format!("{name} {value:.2}")).collect();
            writeln!(parameters, "{name}, {}: {}", kind.as_str(), values.join(", "))?;
        }
    }
    #[expect(clippy::print_stdout, reason = "the table is what this example is for")]
    {
        println!("{table}\n{parameters}");
    }
    Ok(())
}

fn spacing_mse(errors: &Errors) -> f64 {
    errors.spacing_sq / errors.steps as f64
}

fn tasks(splits: &str, files: &[String]) -> Result<BTreeMap<String, Task>, Box<dyn Error>> {
    let mut places = BTreeMap::new();
    for row in csv::Reader::from_path(splits)?.deserialize() {
        let (event_id, task, split): (String, String, String) = row?;
        places.insert(event_id, (task, split));
    }
    let mut tasks = BTreeMap::<String, Task>::new();
    for path in files {
        let kind = BodyKind { format: Format::Parquet, encoding: Encoding::Identity, preset: Preset::Follownet };
        decode(File::open(path)?, kind, &FormatLimits::default(), &mut |decoded| {
            if let Ok(raw) = decoded
                && let Some((task, split)) = places.remove(&raw.event_id)
            {
                let first = |values: &[f64]| values[..STEPS.min(values.len())].iter().map(|&x| x as f32).collect();
                let recording = &raw.recording;
                let event = Event::new(
                    0.1,
                    first(&recording.spacing_m),
                    first(&recording.follower_speed_mps),
                    first(&recording.leader_speed_mps),
                );
                let task = tasks.entry(task).or_default();
                match split.as_str() {
                    "train" => task.train.push(event),
                    "test" => task.test.push(event),
                    _ => {}
                }
            }
            ControlFlow::Continue(())
        })?;
    }
    if let Some(missing) = places.keys().next() {
        return Err(format!("{} events of the splits are in no file, {missing} for one", places.len()).into());
    }
    Ok(tasks)
}
