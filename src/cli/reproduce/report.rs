//! What came out, as one JSON object.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::arguments::{Options, ReproduceArguments, Strength};
use super::plan::Told;
use super::results::{Estimate, LEVEL, Learnt, Matrix, Reference, Results};
use super::safety::Assessed;
use super::sweep::Sweep;
use super::work::Work;
use crate::consolidation::{Method, default_strength};
use crate::evaluation::Errors;
use crate::protocol::{Measure, Measures, Tally};
use crate::safety::Spread;

/// `report.json`.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    events: usize,
    split_mps: Option<Vec<f64>>,
    seeds: Vec<u64>,
    /// Where the settings that were not given come from.
    preset: String,
    settings: Value,
    /// In the order learned; for each name the columns of every R.
    tasks: Vec<String>,
    methods: BTreeMap<&'static str, MethodReport>,
    references: BTreeMap<String, ReferenceReport>,
    comparisons: Vec<Comparison>,
    /// Hard scenarios and a platoon.
    pub(super) safety: Vec<Assessed>,
    /// Errors after stage 2 over λ, by method.
    lambda_sweep: BTreeMap<&'static str, Vec<SweepPoint>>,
    confidence: Confidence,
    protocol: Protocol,
    version: &'static str,
    kernel: String,
    /// What was not learned before this call was learned with so many.
    threads: usize,
    /// That this call took.
    pub(super) seconds: f64,
}

/// Three R, stages × tasks.
#[derive(Debug, Serialize)]
struct Tables {
    spacing_mse: Matrix,
    speed_mse: Matrix,
    collision_rate_percent: Matrix,
}

/// The same of what is served, within the envelope.
#[derive(Debug, Serialize)]
struct Served {
    #[serde(flatten)]
    tables: Tables,
    /// Share of the simulated steps on which the envelope acted for the leader's sake, %.
    acted_percent: Matrix,
    /// Share of those on which it only kept the follower from driving backwards, %.
    held_percent: Matrix,
}

/// Least time to collision of a drive, s, stages × tasks, over the drives with all seeds.
#[derive(Debug, Serialize)]
struct MinTtc {
    alone: Vec<Vec<Spread>>,
    served: Vec<Vec<Spread>>,
}

#[derive(Debug, Serialize)]
struct MethodReport {
    strength: Option<f64>,
    /// Of each stage, the mean over seeds.
    lambda: Option<Vec<Option<f64>>>,
    train_events_per_s: f64,
    #[serde(flatten)]
    tables: Tables,
    served: Served,
    min_ttc_s: MinTtc,
    per_seed: Vec<SeedReport>,
    intervals: Intervals,
    measures: MeasuresReport,
    search: Value,
}

#[derive(Debug, Serialize)]
struct SeedReport {
    seed: u64,
    lambda: Option<Vec<Option<f64>>>,
    train_events_per_s: f64,
    weights_sha256: Vec<String>,
    #[serde(flatten)]
    tables: Tables,
    served: Served,
}

/// Of every cell of R.
#[derive(Debug, Serialize)]
struct Intervals {
    spacing_mse: Vec<Vec<Option<[f64; 2]>>>,
    speed_mse: Vec<Vec<Option<[f64; 2]>>>,
    collision_rate_percent: Vec<Vec<Option<[f64; 2]>>>,
}

/// Of spacing.
#[derive(Debug, Serialize)]
struct MeasuresReport {
    #[serde(flatten)]
    measures: Measures,
    average_interval: Option<[f64; 2]>,
    forgetting_ratio_interval: Option<Vec<Option<[f64; 2]>>>,
    plasticity_loss_interval: Option<Vec<Option<[f64; 2]>>>,
    mean_over_joint: Option<EstimateReport>,
    mean_over_idm: Option<EstimateReport>,
}

/// One row a measure: a reference learns nothing in turn.
#[derive(Debug, Serialize)]
struct ReferenceReport {
    spacing_mse: Vec<f64>,
    speed_mse: Vec<f64>,
    collision_rate_percent: Vec<f64>,
    mean_interval: Option<[f64; 2]>,
    /// On the training events that it was calibrated on, which are as many as `calibration_events` says.
    spacing_mse_calibration: Vec<f64>,
    calibration_events: Vec<u32>,
    /// On the test events with the published parameters.
    spacing_mse_published: Vec<f64>,
    /// As calibrated on each task's training events.
    parameters: Vec<BTreeMap<&'static str, f64>>,
}

#[derive(Debug, Serialize)]
struct EstimateReport {
    value: f64,
    interval: Option<[f64; 2]>,
}

/// Mean over tasks of the last spacing error, `model`'s over `baseline`'s, on the same events and seeds.
#[derive(Debug, Serialize)]
struct Comparison {
    model: String,
    baseline: String,
    ratio: f64,
    interval: Option<[f64; 2]>,
}

/// Of each task.
#[derive(Debug, Serialize)]
struct SweepPoint {
    lambda: f64,
    spacing_mse: Vec<f64>,
}

#[derive(Debug, Serialize)]
struct Confidence {
    level: f64,
    resamples: u32,
    method: &'static str,
}

#[derive(Debug, Serialize)]
struct Protocol {
    steps: u32,
    #[serde(flatten)]
    told: Told,
}

impl From<Estimate> for EstimateReport {
    fn from(Estimate { value, interval }: Estimate) -> Self {
        Self { value, interval }
    }
}

impl Report {
    pub(super) fn new(
        arguments: &ReproduceArguments,
        work: &Work<'_>,
        results: &Results,
        sweeps: &[Sweep],
        safety: Vec<Assessed>,
    ) -> Self {
        let (options, told) = (work.options, &work.plan.told);
        let methods = results.methods.iter();
        Self {
            safety,
            lambda_sweep: sweeps.iter().map(|sweep| (sweep.method.as_str(), points(sweep))).collect(),
            events: told.events,
            split_mps: told.split_mps.clone(),
            seeds: options.seeds.clone(),
            preset: preset(arguments).to_owned(),
            settings: serde_json::to_value(&options.settings).expect("settings are plain data"),
            tasks: told.tasks.iter().map(|task| task.name.clone()).collect(),
            methods: methods.map(|learnt| (learnt.method.as_str(), method(options, results, learnt))).collect(),
            references: references(results),
            comparisons: comparisons(results),
            confidence: Confidence {
                level: LEVEL,
                resamples: arguments.resamples,
                method: "percentiles of a bootstrap that draws whole runs of test events and seeds, the same for all models",
            },
            protocol: Protocol { steps: arguments.steps, told: told.clone() },
            version: env!("CARGO_PKG_VERSION"),
            kernel: crate::lstm::kernel_name().to_owned(),
            threads: work.workers.current_num_threads(),
            seconds: 0.0,
        }
    }
}

fn method(options: &Options, results: &Results, learnt: &Learnt) -> MethodReport {
    let seeds = 0..learnt.seeds.len();
    let (tally, consolidates) = (&learnt.tally, learnt.method.consolidates());
    let intervals = |measure| results.intervals(tally, measure);
    let matrix = |measure| results.matrix(tally, measure);
    let per_seed = seeds.clone().map(|seed| {
        let stages = &learnt.seeds[seed];
        let matrix = |measure| results.matrix_of_seed(tally, measure, seed);
        SeedReport {
            seed: options.seeds[seed],
            lambda: consolidates.then(|| learnt.lambda(seed)),
            train_events_per_s: learnt.train_events_per_s(seed),
            weights_sha256: stages.iter().map(|stage| digest(&stage.learned.weights)).collect(),
            tables: tables(matrix),
            served: Served {
                tables: tables(|measure| results.matrix_of_seed(&learnt.served, measure, seed)),
                acted_percent: learnt.acted_percent(seed..seed + 1),
                held_percent: learnt.held_percent(seed..seed + 1),
            },
        }
    });
    let speeds = seeds.clone().map(|seed| learnt.trained / learnt.train_events_per_s(seed));
    MethodReport {
        strength: strength(learnt),
        lambda: consolidates.then(|| mean_lambda(learnt)),
        train_events_per_s: learnt.trained * learnt.seeds.len() as f64 / speeds.sum::<f64>(),
        tables: tables(matrix),
        served: Served {
            tables: tables(|measure| results.matrix(&learnt.served, measure)),
            acted_percent: learnt.acted_percent(seeds.clone()),
            held_percent: learnt.held_percent(seeds.clone()),
        },
        min_ttc_s: MinTtc { alone: learnt.alone_min_ttc_s(), served: learnt.served_min_ttc_s() },
        per_seed: per_seed.collect(),
        intervals: Intervals {
            spacing_mse: intervals(Measure::Spacing),
            speed_mse: intervals(Measure::Speed),
            collision_rate_percent: intervals(Measure::Collisions),
        },
        measures: measures(results, learnt),
        search: learnt.choice.search.clone(),
    }
}

/// Where the settings that were not given come from.
pub(super) fn preset(arguments: &ReproduceArguments) -> &str {
    arguments.preset.as_deref().unwrap_or("best")
}

/// The strength used; none where there is none, or λ was given.
pub(super) fn strength(learnt: &Learnt) -> Option<f64> {
    match learnt.choice.strength {
        _ if !learnt.method.consolidates() => None,
        Strength::Auto => Some(default_strength(learnt.method)),
        Strength::Fixed(strength) => Some(strength),
        Strength::Lambda(_) => None,
    }
}

/// λ of each stage, the mean over seeds; none at a stage without.
pub(super) fn mean_lambda(learnt: &Learnt) -> Vec<Option<f64>> {
    let seeds: Vec<_> = (0..learnt.seeds.len()).map(|seed| learnt.lambda(seed)).collect();
    let mean = |stage: usize| {
        let sum = seeds.iter().try_fold(0.0, |sum, lambdas| Some(sum + lambdas[stage]?));
        sum.map(|sum| sum / seeds.len() as f64)
    };
    (0..learnt.tally.stages()).map(mean).collect()
}

fn tables(matrix: impl Fn(Measure) -> Matrix) -> Tables {
    Tables {
        spacing_mse: matrix(Measure::Spacing),
        speed_mse: matrix(Measure::Speed),
        collision_rate_percent: matrix(Measure::Collisions),
    }
}

fn measures(results: &Results, learnt: &Learnt) -> MeasuresReport {
    let tally = &learnt.tally;
    let over = |other: Option<&Tally>| results.compared(tally, other?).map(EstimateReport::from);
    let intervals = |estimates: Option<Vec<Estimate>>| {
        estimates.map(|estimates| estimates.into_iter().map(|estimate| estimate.interval).collect())
    };
    MeasuresReport {
        measures: results.measures(learnt),
        average_interval: results.last_mean(tally, Measure::Spacing).interval,
        forgetting_ratio_interval: intervals(results.forgetting_ratios(learnt)),
        plasticity_loss_interval: intervals(results.plasticity_losses(learnt)),
        mean_over_joint: over(results.method(Method::Joint).map(|joint| &joint.tally)),
        mean_over_idm: over(results.reference("idm").map(|idm| &idm.tally)),
    }
}

fn references(results: &Results) -> BTreeMap<String, ReferenceReport> {
    let row = |tally: &Tally, measure| results.matrix(tally, measure).remove(0);
    let report = |reference: &Reference| ReferenceReport {
        spacing_mse: row(&reference.tally, Measure::Spacing),
        speed_mse: row(&reference.tally, Measure::Speed),
        collision_rate_percent: row(&reference.tally, Measure::Collisions),
        mean_interval: results.last_mean(&reference.tally, Measure::Spacing).interval,
        spacing_mse_calibration: reference.fitted_to.iter().map(Errors::spacing_mse).collect(),
        calibration_events: reference.fitted_to.iter().map(|errors| errors.events).collect(),
        spacing_mse_published: reference.published.iter().map(Errors::spacing_mse).collect(),
        parameters: reference.drivers.iter().map(|driver| driver.named_values().collect()).collect(),
    };
    results.references.iter().map(|reference| (reference.name.clone(), report(reference))).collect()
}

fn points(sweep: &Sweep) -> Vec<SweepPoint> {
    let point =
        |point: &super::sweep::Point| SweepPoint { lambda: point.lambda, spacing_mse: point.spacing_mse.clone() };
    sweep.points.iter().map(point).collect()
}

/// Every method with every model named before it, and with every reference.
fn comparisons(results: &Results) -> Vec<Comparison> {
    let learnt = results.methods.iter().map(|learnt| (learnt.method.as_str(), &learnt.tally));
    let references = results.references.iter().map(|reference| (reference.name.as_str(), &reference.tally));
    let models: Vec<_> = learnt.chain(references).collect();
    let mut comparisons = Vec::new();
    for (place, (model, tally)) in models.iter().enumerate().take(results.methods.len()) {
        let baselines = models[..place].iter().chain(&models[results.methods.len()..]);
        for (baseline, other) in baselines {
            let Some(Estimate { value, interval }) = results.compared(tally, other) else { continue };
            let (model, baseline) = ((*model).to_owned(), (*baseline).to_owned());
            comparisons.push(Comparison { model, baseline, ratio: value, interval });
        }
    }
    comparisons
}

fn digest(weights: &[f32]) -> String {
    let mut hasher = Sha256::new();
    for weight in weights {
        hasher.update(weight.to_le_bytes());
    }
    hex::encode(hasher.finalize())
}
