//! How far the sampled estimators of importance are from the exact ones, on generated traffic:
//! `cargo run --release --example estimator_error -- 500 64` (events, hidden units).

#![expect(clippy::print_stdout, reason = "the table is the result")]

use std::error::Error;
use std::time::Instant;

use headway::car_following::{Event, TrafficRegime, TrafficSettings, generate};
use headway::consolidation::{Estimator, ImportanceOptions, Kept, MasOutput, Method, Output, importance};
use headway::driver::{Crew, DriverShape, Scaling};
use headway::lineage::ModelSettings;
use headway::training::{StageInput, Unwatched, learn_stage};
use rayon::ThreadPool;

/// A network that has learned the events: its weights and scaling.
fn learn(
    settings: &ModelSettings,
    train: &[Event],
    workers: &ThreadPool,
) -> Result<(Vec<f32>, Scaling), Box<dyn Error>> {
    let input = StageInput {
        method: Method::Naive,
        settings: settings.learning(),
        stage: 1,
        regime: "slow",
        parent_weights: None,
        scaling: None,
        memory: &[],
        replay: &[],
        train,
        validation: &[],
    };
    let learned = learn_stage(&input, None, workers, &mut Unwatched)?;
    Ok((learned.weights, learned.scaling))
}

/// Root mean square of the relative differences, weights of importance zero left out; and the ratio of the sums.
fn compare(estimate: &[f64], exact: &[f64]) -> (f64, f64) {
    let both = || estimate.iter().zip(exact).filter(|(_, exact)| **exact > 0.0);
    let squares: f64 = both().map(|(estimate, exact)| (estimate / exact - 1.0).powi(2)).sum();
    ((squares / both().count() as f64).sqrt(), estimate.iter().sum::<f64>() / exact.iter().sum::<f64>())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [events, hidden] = arguments.as_slice() else {
        return Err("two arguments, please: the number of events and of hidden units".into());
    };
    let settings = ModelSettings { hidden: hidden.parse()?, ..headway::lineage::Preset::Paper.settings() };
    let lengths = TrafficSettings { min_steps: 150, max_steps: 150, ..TrafficSettings::default() };
    let generated = generate(TrafficRegime::Slow, 42, events.parse()?, &lengths);
    let events: Vec<Event> = generated.into_iter().map(|generated| generated.event).collect();
    let workers = rayon::ThreadPoolBuilder::new().build()?;
    let (weights, scaling) = learn(&settings, &events, &workers)?;
    let shape: DriverShape = settings.shape();
    let crew = Crew::<f32>::new(shape, &workers);
    let borrowed: Vec<&Event> = events.iter().collect();
    let compute = |kept, estimator, draws| {
        let options = ImportanceOptions { estimator, output: Output::OpenLoop, mas_output: MasOutput::Jacobian, draws };
        let began = Instant::now();
        let (values, _) =
            importance(kept, options, &crew, &scaling, &weights, &borrowed, &mut || true).expect("nobody stops it");
        (values, began.elapsed().as_secs_f64())
    };
    println!("| importance | draws | RMS relative error of a weight | sum / exact sum | s | s, exact |");
    println!("| --- | --- | --- | --- | --- | --- |");
    for (name, kept, all_draws) in
        [("Fisher", Kept::Fisher, [1, 4, 16]), ("sensitivity", Kept::Sensitivity, [3, 4, 16])]
    {
        let (exact, exact_s) = compute(kept, Estimator::Exact, 1);
        for draws in all_draws {
            let (estimate, s) = compute(kept, Estimator::Sampled, draws);
            let (error, ratio) = compare(&estimate, &exact);
            println!("| {name} | {draws} | {error:.3} | {ratio:.3} | {s:.1} | {exact_s:.1} |");
        }
    }
    Ok(())
}
