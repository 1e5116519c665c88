//! Settings of the predictor.

use std::ops::RangeInclusive;

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

impl PredictorSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 2] {
        [
            ("named_versions", self.named_versions as f64, 0.0..=10_000.0),
            ("inline_windows", self.inline_windows as f64, 0.0..=1e6),
        ]
    }
}
