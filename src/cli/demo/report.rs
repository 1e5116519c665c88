//! What came out, as one JSON object.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Serialize;

use super::answers::Receipt;
use super::story::{MODELS, RolledBack, Stage, Story};
use super::tables::{Measure, matrix};

/// Everything that the story tells.
#[derive(Serialize)]
pub(super) struct Report<'a> {
    url: &'a str,
    seed: u64,
    /// The regimes, in the order learned: columns of every table.
    tasks: Vec<&'static str>,
    split_mps: Option<[f64; 2]>,
    left_out: Vec<usize>,
    models: BTreeMap<&'static str, ModelReport<'a>>,
    #[serde(flatten)]
    rolled_back: RolledBack,
    curl: &'a [String; 3],
    seconds: f64,
}

/// One model's way.
#[derive(Serialize)]
struct ModelReport<'a> {
    uploads: Vec<&'a Receipt>,
    stages: &'a [Stage],
    /// Stages × tasks; null where a task was not learned yet.
    spacing_mse: Vec<Vec<Option<f64>>>,
    speed_mse: Vec<Vec<Option<f64>>>,
    collision_rate_percent: Vec<Vec<Option<f64>>>,
    /// Of each task but the last: `R[3,j] / R[j,j]`.
    forgetting_ratio: Vec<Option<f64>>,
}

impl<'a> Report<'a> {
    pub(super) fn new(story: &'a Story<'_>, rolled_back: RolledBack, curl: &'a [String; 3], took: Duration) -> Self {
        let tasks = story.regimes();
        let model = |model: &'static str| {
            let stages = story.stages(model);
            let evaluations: Vec<_> = stages.iter().map(|stage| &stage.evaluation).collect();
            let table = |measure| matrix(&evaluations, &tasks, measure);
            let report = ModelReport {
                uploads: stages.iter().map(|stage| &stage.upload).collect(),
                stages,
                spacing_mse: table(Measure::Spacing),
                speed_mse: table(Measure::Speed),
                collision_rate_percent: table(Measure::Collisions),
                forgetting_ratio: story.forgetting(model),
            };
            (model, report)
        };
        Self {
            url: story.server.url(),
            seed: story.arguments.seed,
            models: MODELS.into_iter().map(model).collect(),
            split_mps: story.traffic.split_mps,
            left_out: story.traffic.regimes.iter().map(|regime| regime.left_out).collect(),
            tasks,
            rolled_back,
            curl,
            seconds: took.as_secs_f64(),
        }
    }
}
