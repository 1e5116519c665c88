//! Settings of the predictor.

use serde::{Deserialize, Serialize};

/// How much is kept loaded, and what is computed where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictorSettings {
    /// Versions kept loaded beside the live ones, because somebody named them.
    pub named_versions: usize,
    /// Requests of up to so many windows or steps are computed where they arrive, larger ones on a blocking thread.
    pub inline_windows: usize,
}
