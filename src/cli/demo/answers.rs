//! What the API answers, as far as the demo reads it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Of an upload.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(super) struct Receipt {
    pub(super) batch_id: String,
    pub(super) accepted: u64,
    pub(super) duplicates: u64,
    pub(super) rejected_count: u64,
    pub(super) summary: Summary,
}

/// The accepted events of an upload.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(super) struct Summary {
    pub(super) mean_speed_mps: Option<SpeedRange>,
    pub(super) splits: BTreeMap<String, u64>,
}

/// Mean follower speeds, from the slowest event to the fastest.
#[derive(Debug, Clone, Copy, Deserialize, Serialize)]
pub(super) struct SpeedRange {
    pub(super) min: f64,
    pub(super) max: f64,
}

/// Of a model.
#[derive(Debug, Deserialize)]
pub(super) struct Model {
    pub(super) live: Option<i64>,
    pub(super) settings: ModelSettings,
}

/// Its settings.
#[derive(Debug, Deserialize)]
pub(super) struct ModelSettings {
    pub(super) hidden: u32,
    pub(super) epochs: u32,
}

/// Of a version's evaluation.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(super) struct Evaluation {
    pub(super) version: i64,
    pub(super) stage: u32,
    pub(super) tasks: Vec<RegimeMeasures>,
}

/// How a version drives on the test events of one regime.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(super) struct RegimeMeasures {
    pub(super) regime: String,
    pub(super) events: u64,
    pub(super) spacing_mse: Option<f64>,
    pub(super) speed_mse: Option<f64>,
    pub(super) collision_rate_percent: Option<f64>,
    pub(super) forgetting_ratio: Option<f64>,
}

/// Of a prediction.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(super) struct Predicted {
    pub(super) version: i64,
    pub(super) predictions: Vec<Prediction>,
}

/// Of one window.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(super) struct Prediction {
    pub(super) accel_mps2: f64,
    pub(super) flags: Vec<String>,
}

/// Of a rollback.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub(super) struct Moved {
    pub(super) from: i64,
    pub(super) live: i64,
    pub(super) head: i64,
    pub(super) history_id: String,
}
