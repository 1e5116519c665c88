//! Every estimator of importance against `torch`, against differences, and against itself cut and shuffled.

use headway::car_following::Event;
use headway::consolidation::{Estimator, ImportanceOptions, Kept, MasOutput, Output, importance};
use headway::driver::{Crew, Drive, DriverShape, Loop, Scaling};
use headway::lstm::{Network, Real};
use serde::Deserialize;

use super::golden::GoldenDriver;

#[derive(Deserialize)]
struct Golden {
    #[serde(flatten)]
    driver: GoldenDriver,
    samples: u64,
    fisher: Over,
    jacobian: Over,
    squared_norm: Over,
}

#[derive(Deserialize)]
struct Over {
    open_loop: Wide,
    closed_loop: Wide,
    empirical: Option<Wide>,
}

#[derive(Deserialize)]
struct Wide {
    input: Vec<f64>,
    recurrent: Vec<f64>,
    bias: Vec<f64>,
    head: Vec<f64>,
    head_bias: Vec<f64>,
}

impl Wide {
    fn flat(&self) -> Vec<f64> {
        [&self.input, &self.recurrent, &self.bias, &self.head, &self.head_bias].into_iter().flatten().copied().collect()
    }
}

struct Case {
    golden: Golden,
    shape: DriverShape,
    scaling: Scaling,
    events: Vec<Event>,
    weights: Vec<f32>,
}

fn case() -> Case {
    let golden: Golden = serde_json::from_str(include_str!("../golden/importance.json")).unwrap();
    let (shape, scaling, events) = (golden.driver.shape(), golden.driver.scaling(), golden.driver.events());
    let weights = golden.driver.weights.flat();
    Case { golden, shape, scaling, events, weights }
}

fn exact(output: Output) -> ImportanceOptions {
    ImportanceOptions { estimator: Estimator::Exact, output, mas_output: MasOutput::Jacobian, draws: 4 }
}

/// Every importance that can be computed exactly, by name.
fn all_exact() -> Vec<(&'static str, Kept, ImportanceOptions)> {
    let (open, closed) = (exact(Output::OpenLoop), exact(Output::ClosedLoop));
    let squared = |options| ImportanceOptions { mas_output: MasOutput::SquaredNorm, ..options };
    vec![
        ("fisher", Kept::Fisher, open),
        ("empirical fisher", Kept::Fisher, ImportanceOptions { estimator: Estimator::Empirical, ..open }),
        ("closed fisher", Kept::Fisher, closed),
        ("jacobian", Kept::Sensitivity, open),
        ("closed jacobian", Kept::Sensitivity, closed),
        ("squared norm", Kept::Sensitivity, squared(open)),
        ("closed squared norm", Kept::Sensitivity, squared(closed)),
    ]
}

fn of_torch(golden: &Golden, name: &str) -> Vec<f64> {
    let over = match name {
        "fisher" | "empirical fisher" | "closed fisher" => &golden.fisher,
        "jacobian" | "closed jacobian" => &golden.jacobian,
        _ => &golden.squared_norm,
    };
    match name.split(' ').next() {
        Some("closed") => over.closed_loop.flat(),
        Some("empirical") => over.empirical.as_ref().unwrap().flat(),
        _ => over.open_loop.flat(),
    }
}

fn compute<T: Real>(
    case: &Case,
    kept: Kept,
    options: ImportanceOptions,
    events: &[&Event],
    threads: usize,
) -> (Vec<f64>, u64) {
    let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let crew = Crew::<T>::new(case.shape, &workers);
    let weights: Vec<T> = case.weights.iter().map(|&w| T::of(w.into())).collect();
    importance(kept, options, &crew, &case.scaling, &weights, events, &mut || true).unwrap()
}

/// Largest difference in units of the largest value.
fn off(ours: &[f64], theirs: &[f64]) -> f64 {
    assert_eq!(ours.len(), theirs.len());
    let scale = theirs.iter().copied().fold(0.0, f64::max);
    ours.iter().zip(theirs).map(|(a, b)| (a - b).abs() / scale).fold(0.0, f64::max)
}

#[test]
fn every_exact_importance_is_torchs() {
    let case = case();
    let events: Vec<_> = case.events.iter().collect();
    for (name, kept, options) in all_exact() {
        let theirs = of_torch(&case.golden, name);
        let (wide, samples) = compute::<f64>(&case, kept, options, &events, 1);
        assert_eq!(samples, case.golden.samples);
        assert!(off(&wide, &theirs) < 1e-10, "{name}: off by {}", off(&wide, &theirs));
        let (single, _) = compute::<f32>(&case, kept, options, &events, 2);
        assert!(off(&single, &theirs) < 1e-4, "{name}: f32 off by {}", off(&single, &theirs));
    }
}

/// What a drive answers at each step from the horizon on, and the acceleration recorded there.
struct Answer {
    accel: f64,
    spacing: f64,
    speed: f64,
    recorded: f64,
}

fn answers(case: &Case, weights: &[f64], which: Loop) -> Vec<Answer> {
    let mut drive = Drive::<f64>::new(case.shape);
    let mut answers = Vec::new();
    let network = Network::new(case.shape.layout(), weights);
    for event in &case.events {
        drive.forward(&network, &case.scaling, &[event], which);
        let v = |t: usize| f64::from(event.follower_speed_mps()[t]);
        answers.extend((case.shape.horizon..event.steps()).map(|t| Answer {
            accel: drive.accel_mps2(t, 0),
            spacing: drive.spacing_m(t, 0),
            speed: drive.speed_mps(t, 0),
            recorded: (v(t) - v(t - 1)) / f64::from(case.shape.dt_s),
        }));
    }
    answers
}

/// The scalars that an importance is about, straight from its definition.
fn scalars(name: &str, answers: &[Answer]) -> Vec<f64> {
    let each = answers.iter();
    match name {
        "fisher" | "jacobian" => each.map(|a| a.accel).collect(),
        "empirical fisher" => each.map(|a| 0.5 * (a.accel - a.recorded).powi(2)).collect(),
        "squared norm" => each.map(|a| a.accel.powi(2)).collect(),
        "closed squared norm" => each.map(|a| a.spacing.powi(2) + a.speed.powi(2)).collect(),
        _ => each.flat_map(|a| [a.spacing, a.speed]).collect(),
    }
}

#[test]
fn every_exact_importance_agrees_with_central_differences_of_each_step() {
    let case = case();
    let events: Vec<_> = case.events.iter().collect();
    for (name, kept, options) in all_exact() {
        let which = if options.output == Output::ClosedLoop { Loop::Closed } else { Loop::Open };
        let mut weights: Vec<f64> = case.weights.iter().map(|&w| f64::from(w)).collect();
        let differences: Vec<f64> = (0..weights.len())
            .map(|i| {
                let (own, h) = (weights[i], 1e-5);
                weights[i] = own + h;
                let up = scalars(name, &answers(&case, &weights, which));
                weights[i] = own - h;
                let down = scalars(name, &answers(&case, &weights, which));
                weights[i] = own;
                let each = up.iter().zip(&down).map(|(up, down)| (up - down) / (2.0 * h));
                let sum: f64 = each.map(|g| if kept == Kept::Fisher { g * g } else { g.abs() }).sum();
                sum / case.golden.samples as f64
            })
            .collect();
        let (ours, _) = compute::<f64>(&case, kept, options, &events, 1);
        assert!(off(&ours, &differences) < 1e-6, "{name}: off by {}", off(&ours, &differences));
    }
}

/// Copies of the events, each with noise of its own: too little to matter, enough for another digest.
fn copies(events: &[Event], count: usize) -> Vec<Event> {
    let copy = |event: &Event, k: usize| {
        let spacing = event.spacing_m().iter().map(|s| s * (1.0 + k as f32 * 1e-6)).collect();
        Event::new(event.dt_s(), spacing, event.follower_speed_mps().to_vec(), event.leader_speed_mps().to_vec())
    };
    (0..count).flat_map(|k| events.iter().map(move |event| copy(event, k))).collect()
}

#[test]
fn the_sampled_estimators_are_right_on_average_and_as_noisy_as_they_say() {
    const COPIES: usize = 400;
    let case = case();
    for (name, kept, options) in all_exact() {
        if options.estimator == Estimator::Empirical {
            continue;
        }
        let theirs = of_torch(&case.golden, name);
        let options = ImportanceOptions { estimator: Estimator::Sampled, draws: 4, ..options };
        let estimates: Vec<Vec<f64>> = copies(&case.events, COPIES)
            .chunks(case.events.len())
            .map(|events| compute::<f64>(&case, kept, options, &events.iter().collect::<Vec<_>>(), 1).0)
            .collect();
        // One event's relative variance; three events at most make it smaller, and never larger.
        let one_event = if kept == Kept::Fisher { 2.0 / 4.0 } else { 1.123 };
        let mut variances = Vec::new();
        for (i, expected) in theirs.iter().enumerate() {
            let mean = estimates.iter().map(|e| e[i]).sum::<f64>() / COPIES as f64;
            let variance = estimates.iter().map(|e| (e[i] / expected - 1.0).powi(2)).sum::<f64>() / COPIES as f64;
            let error = (one_event / COPIES as f64).sqrt();
            assert!((mean / expected - 1.0).abs() < 5.0 * error, "{name}, weight {i}: {mean}, torch {expected}");
            variances.push(variance);
        }
        let mean_variance = variances.iter().sum::<f64>() / variances.len() as f64;
        assert!(mean_variance < one_event && mean_variance > one_event / 6.0, "{name}: variance {mean_variance}");
    }
}

#[test]
fn no_estimator_depends_on_order_threads_or_company() {
    let case = case();
    let events = copies(&case.events, 40);
    let sorted: Vec<_> = events.iter().collect();
    let (first, rest) = sorted.split_at(50);
    for (name, kept, exact) in all_exact() {
        let sampled = ImportanceOptions { estimator: Estimator::Sampled, ..exact };
        for options in [exact, sampled] {
            let (whole, samples) = compute::<f32>(&case, kept, options, &sorted, 1);
            assert_eq!(compute::<f32>(&case, kept, options, &sorted, 3), (whole.clone(), samples), "{name}: threads");
            // The order of the sums may change the last bits, how events come in batches nothing more.
            let reversed: Vec<_> = sorted.iter().rev().copied().collect();
            let (backwards, _) = compute::<f32>(&case, kept, options, &reversed, 2);
            let parts = [first, rest].map(|part| compute::<f32>(&case, kept, options, part, 2));
            let together: Vec<f64> = (0..whole.len())
                .map(|i| parts.iter().map(|(sums, n)| sums[i] * *n as f64).sum::<f64>() / samples as f64)
                .collect();
            for other in [backwards, together] {
                assert!(off(&other, &whole) < 1e-5, "{name}: off by {}", off(&other, &whole));
            }
        }
    }
}
