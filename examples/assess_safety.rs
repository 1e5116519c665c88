//! Learns recorded events with the settings of the paper and measures how safely the network drives, alone and as it is served, beside calibrated IDM:
//! `cargo run --release --example assess_safety -- METHOD HIDDEN SEED SPLITS.csv EVENTS.parquet…`.
//!
//! SPLITS has the columns `event_id, task, split`; tasks are learned in the order of their numbers, events cut to 150 steps.

use std::collections::{BTreeMap, HashMap};
use std::error::Error;
use std::fs::{File, read_to_string};
use std::io::Write;
use std::ops::ControlFlow;

use headway::car_following::Event;
use headway::consolidation::{Method, RegimeMemory};
use headway::driver::Scaling;
use headway::evaluation::{
    CalibrationSettings, calibrate, drive_events, evaluate, evaluate_reference, evaluate_served,
};
use headway::formats::{BodyKind, Encoding, Format, FormatLimits, Preset, decode};
use headway::lineage::ModelSettings;
use headway::reference::ReferenceKind;
use headway::safety::{Envelope, Platoon, StressSettings, Surrogates, Trajectory, assess, markdown, stress_set};
use headway::training::{Interim, LearnSettings, Learned, Observer, Progress, StageInput, learn_stage};
use rayon::ThreadPool;

/// Every event is cut to so many steps.
const STEPS: usize = 150;

/// Training and test events of one task.
#[derive(Default)]
struct Task {
    train: Vec<Event>,
    test: Vec<Event>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [method, hidden, seed, splits, files @ ..] = arguments.as_slice() else {
        return Err("method, hidden units, seed, a file of splits and files of events, please".into());
    };
    let method = serde_json::from_value::<Method>(method.as_str().into())?;
    let (hidden, seed): (u32, u64) = (hidden.parse()?, seed.parse()?);
    let settings = ModelSettings { hidden, seed, ..headway::lineage::Preset::Paper.settings() }.learning();
    let tasks = tasks(splits, files)?;
    let workers = rayon::ThreadPoolBuilder::new().num_threads(2).build()?;
    let learned = learn(method, &settings, &tasks, &workers)?;
    report(&settings, &learned, &tasks, &workers)
}

fn tasks(splits: &str, files: &[String]) -> Result<BTreeMap<String, Task>, Box<dyn Error>> {
    let mut place: HashMap<String, (String, String)> = HashMap::new();
    for line in read_to_string(splits)?.lines().skip(1) {
        if let [event, task, split] = line.split(',').collect::<Vec<_>>()[..] {
            place.insert(event.to_owned(), (task.to_owned(), split.to_owned()));
        }
    }
    let mut tasks: BTreeMap<String, Task> = BTreeMap::new();
    for file in files {
        let kind = BodyKind { format: Format::Parquet, encoding: Encoding::Identity, preset: Preset::Follownet };
        decode(File::open(file)?, kind, &FormatLimits::default(), &mut |decoded| {
            if let Ok(raw) = decoded
                && let Some((task, split)) = place.get(&raw.event_id)
            {
                let cut = |values: &[f64]| values.iter().take(STEPS).map(|&x| x as f32).collect();
                let recording = &raw.recording;
                let event = Event::new(
                    0.1,
                    cut(&recording.spacing_m),
                    cut(&recording.follower_speed_mps),
                    cut(&recording.leader_speed_mps),
                );
                let task = tasks.entry(task.clone()).or_default();
                match split.as_str() {
                    "train" => task.train.push(event),
                    "test" => task.test.push(event),
                    _ => {}
                }
            }
            ControlFlow::Continue(())
        })?;
    }
    Ok(tasks)
}

/// A driver by its name.
type Named<'a> = (&'static str, Box<dyn FnMut(&[Event]) -> Vec<Trajectory> + 'a>);

/// Nobody watches.
struct Unwatched;

impl Observer for Unwatched {
    fn updated(&mut self, _: &Progress) -> bool {
        true
    }
    fn evaluated(&mut self, _: &Interim) {}
    fn wants_stop(&mut self) -> bool {
        false
    }
    fn wants_checkpoint(&mut self) -> bool {
        false
    }
    fn checkpoint(&mut self, _: &Progress, _: Vec<u8>) {}
}

/// The network after the last task.
fn learn(
    method: Method,
    settings: &LearnSettings,
    tasks: &BTreeMap<String, Task>,
    workers: &ThreadPool,
) -> Result<Learned, Box<dyn Error>> {
    let mut stages: Vec<(&str, Vec<Event>)> =
        tasks.iter().map(|(name, task)| (name.as_str(), task.train.clone())).collect();
    // The joint model is scaled by the first task, as a line of tasks is.
    let first: Vec<&Event> = stages.first().ok_or("no event is in the splits")?.1.iter().collect();
    let scaling = Scaling::estimate(settings.shape, &first);
    if method == Method::Joint {
        stages = vec![("all", stages.into_iter().flat_map(|(_, train)| train).collect())];
    }
    let (mut memory, mut last): (Vec<RegimeMemory>, Option<Learned>) = (Vec::new(), None);
    for (stage, (regime, train)) in (1..).zip(&stages) {
        let input = StageInput {
            method,
            settings: settings.clone(),
            stage,
            regime,
            parent_weights: last.as_ref().map(|learned| learned.weights.as_slice()),
            scaling: Some(scaling),
            memory: &memory,
            train,
            validation: &[],
            replay: &[],
        };
        let learned = learn_stage(&input, None, workers, &mut Unwatched)?;
        memory.extend(learned.memory.clone());
        last = Some(learned);
    }
    Ok(last.expect("there is a task"))
}

fn report(
    settings: &LearnSettings,
    learned: &Learned,
    tasks: &BTreeMap<String, Task>,
    workers: &ThreadPool,
) -> Result<(), Box<dyn Error>> {
    let (shape, scaling, weights) = (settings.shape, &learned.scaling, &learned.weights);
    let envelope = Envelope::new(shape.dt_s);
    let train: Vec<&Event> = tasks.values().flat_map(|task| &task.train).collect();
    let idm = calibrate(ReferenceKind::Idm, shape.horizon, &train, &CalibrationSettings::default(), workers).driver;
    let alone = |events: &[Event]| drive_events(shape, scaling, weights, None, events, workers);
    let served = |events: &[Event]| drive_events(shape, scaling, weights, Some(envelope), events, workers);
    let by_idm = |events: &[Event]| -> Vec<Trajectory> {
        events.iter().map(|event| idm.drive(event, shape.horizon).into()).collect()
    };
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "| task | spacing MSE alone | served | IDM | acted, % of steps | held | collisions alone | served | min TTC median (least) alone, s | served |"
    )?;
    writeln!(out, "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")?;
    for (name, task) in tasks {
        let network = evaluate(shape, scaling, weights, &task.test, workers);
        let bounded = evaluate_served(shape, scaling, weights, &task.test, workers);
        let reference = evaluate_reference(&idm, shape.horizon, &task.test, workers);
        let steps = network.steps as f64;
        writeln!(
            out,
            "| {name} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} | {} | {} | {} | {} |",
            network.spacing_sq / steps,
            bounded.errors.spacing_sq / steps,
            reference.spacing_sq / steps,
            100.0 * bounded.acted_steps as f64 / steps,
            100.0 * bounded.held_steps as f64 / steps,
            network.collisions,
            bounded.errors.collisions,
            times(&task.test, &alone(&task.test), shape.horizon),
            times(&task.test, &served(&task.test), shape.horizon),
        )?;
    }
    let set = stress_set(&StressSettings::published(shape.dt_s.into(), shape.horizon));
    let platoon = Platoon::published(0.1, shape.horizon);
    let mut drivers: [Named<'_>; 3] =
        [("network alone", Box::new(alone)), ("served", Box::new(served)), ("IDM", Box::new(by_idm))];
    let reports: Vec<_> = drivers
        .iter_mut()
        .map(|(name, drive)| (*name, assess(&set, shape.horizon, &platoon, drive.as_mut())))
        .collect();
    let borrowed: Vec<_> = reports.iter().map(|(name, report)| (*name, report)).collect();
    writeln!(out, "\n{}", markdown(&borrowed))?;
    Ok(())
}

/// Median and least of the drives' least times to collision, s.
fn times(events: &[Event], driven: &[Trajectory], horizon: usize) -> String {
    let mut times: Vec<f64> = events
        .iter()
        .zip(driven)
        .map(|(event, driven)| Surrogates::of(event, driven, horizon).min_ttc_s.unwrap_or(f64::INFINITY))
        .collect();
    times.sort_by(f64::total_cmp);
    format!("{:.1} ({:.1})", times[times.len() / 2], times[0])
}
