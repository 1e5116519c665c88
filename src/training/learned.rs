//! What a stage comes to.

use serde::{Deserialize, Serialize};

use crate::consolidation::RegimeMemory;
use crate::driver::Scaling;

/// The outcome.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Learned {
    /// One flat vector.
    pub weights: Vec<f32>,
    /// The line's scaling.
    pub scaling: Scaling,
    /// What to keep of this regime, merged with what was kept of it before; none for `naive` and `joint`.
    pub memory: Option<RegimeMemory>,
    /// The strength used; none where unused.
    pub strength: Option<f64>,
    /// The number in the formula; none where unused (also at stage 1).
    pub lambda: Option<f64>,
    /// Name of the arithmetic.
    pub kernel: String,
    /// Time inside updates, s.
    pub update_s: f64,
}

/// Why a stage gave no weights.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LearnError {
    /// No event is long enough to drive.
    #[error("no training event is longer than the horizon")]
    NoTrainingEvents,
    /// Training made the driver worse than none.
    #[error("training diverged at update {update}: {detail}")]
    Diverged {
        /// The update.
        update: u64,
        /// What was seen.
        detail: String,
    },
    /// The observer said stop; a checkpoint was given first.
    #[error("stopped")]
    Stopped,
    /// The checkpoint does not belong to this input.
    #[error("the checkpoint does not fit: {0}")]
    Checkpoint(String),
}
