//! The immutable outcome of a task.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{ModelSettings, Promotion, RegimeName, StrengthSearch};
use crate::consolidation::Method;
use crate::evaluation::{Errors, ServedErrors};

/// A version without its weights.
#[derive(Debug, Clone, PartialEq)]
pub struct Version {
    /// The model's row id.
    pub model_id: i64,
    /// 1, 2, 3… per model.
    pub version: i64,
    /// The task that made it; none where it came as a file.
    pub task_id: Option<i64>,
    /// The version it continued; none at stage 1, and where it came as a file.
    pub parent: Option<i64>,
    /// Position on its line of parents, from 1.
    pub stage: u32,
    /// The regime it learned.
    pub regime: RegimeName,
    /// The model's method.
    pub method: Method,
    /// Resolved.
    pub settings: ModelSettings,
    /// The strength it was learned with; null where unused.
    pub strength: Option<f64>,
    /// The number that ended up in the formula; null where unused.
    pub lambda: Option<f64>,
    /// How the strength was found; none where it was not searched.
    pub strength_search: Option<StrengthSearch>,
    /// Name of the arithmetic that made it.
    pub kernel: String,
    /// Training events of its stage.
    pub train_events: u64,
    /// SHA-256 over the sorted digests of the training events, hex.
    pub events_sha256: String,
    /// Standardisation, JSON (see `training::Scaling`).
    pub scaling: Value,
    /// Summary per layer, JSON; null where no importance is kept.
    pub importance: Value,
    /// SHA-256 over the little-endian weights, hex.
    pub weights_sha256: String,
    /// What the promotion policy decided.
    pub promotion: Promotion,
    /// Whether it, or one it continues, learned what was retracted later.
    pub tainted: bool,
    /// Whether its weights and anchors were not kept.
    pub pruned: bool,
    /// A person's remark.
    pub note: Option<String>,
    /// When the task ended.
    pub created_at: Timestamp,
    /// How what is stored of it differs from what was written, where that is known; none as long as it is good.
    pub corrupt: Option<String>,
}

/// Closed-loop measures on test events, pooled over simulated steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TestMeasures {
    /// m².
    pub spacing_mse: f64,
    /// m²/s².
    pub speed_mse: f64,
    /// Events with some simulated spacing ≤ 0.
    pub collisions: u32,
    /// Events driven.
    pub events: u32,
    /// Simulated steps.
    pub steps: u64,
}

impl TestMeasures {
    /// Means over simulated steps; none without any.
    #[must_use]
    pub fn of(errors: &Errors) -> Option<Self> {
        let Errors { spacing_sq, speed_sq, collisions, events, steps } = *errors;
        (steps > 0).then(|| Self {
            spacing_mse: spacing_sq / steps as f64,
            speed_mse: speed_sq / steps as f64,
            collisions,
            events,
            steps,
        })
    }
}

/// The same measures of what is served: the network within the envelope.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ServedMeasures {
    /// m².
    pub spacing_mse: f64,
    /// m²/s².
    pub speed_mse: f64,
    /// Events with some simulated spacing ≤ 0.
    pub collisions: u32,
    /// Simulated steps on which the envelope acted for the leader's sake.
    pub acted_steps: u64,
    /// Simulated steps on which it kept the follower from driving backwards.
    pub held_steps: u64,
}

impl ServedMeasures {
    /// Means over simulated steps; none without any.
    #[must_use]
    pub fn of(served: &ServedErrors) -> Option<Self> {
        let TestMeasures { spacing_mse, speed_mse, collisions, .. } = TestMeasures::of(&served.errors)?;
        Some(Self {
            spacing_mse,
            speed_mse,
            collisions,
            acted_steps: served.acted_steps,
            held_steps: served.held_steps,
        })
    }
}

/// How a version drives in one regime its line has learned.
#[derive(Debug, Clone, PartialEq)]
pub struct RegimeEvaluation {
    /// The regime.
    pub regime: RegimeName,
    /// The last stage that learned it.
    pub learned_stage: u32,
    /// The version of that stage.
    pub learned_version: i64,
    /// Null without test events.
    pub measures: Option<TestMeasures>,
    /// On the same events with the envelope; null without test events and where the version has none.
    pub served: Option<ServedMeasures>,
    /// The parent's, on the newly learned regime only.
    pub before: Option<TestMeasures>,
    /// `R[j,j]`: spacing error at `learned_version`.
    pub diagonal_spacing_mse: Option<f64>,
    /// Least spacing error since `learned_version`, this version excluded.
    pub best_spacing_mse: Option<f64>,
}
