//! Settings of access.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Keys and their limits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AccessSettings {
    /// A file with an admin key that is made known at the start; none when empty.
    pub key_file: PathBuf,
    /// Most keys, those that have ended included.
    pub max_keys: u32,
    /// The window of the limits below, s.
    pub rate_window_s: u32,
    /// Requests of one key within a window, other than those below; 0: no limit.
    pub rate_requests: u32,
    /// Predictions, simulations and evaluations of one key within a window, counted by request; 0: no limit.
    pub rate_predictions: u32,
    /// Of requests that are refused for want of a key, or because a key asked too much, one within so long is logged, s.
    pub refusal_log_s: f64,
}

impl AccessSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 5] {
        [
            ("max_keys", self.max_keys.into(), 1.0..=1e6),
            ("rate_window_s", self.rate_window_s.into(), 1.0..=86_400.0),
            ("rate_requests", self.rate_requests.into(), 0.0..=1e9),
            ("rate_predictions", self.rate_predictions.into(), 0.0..=1e9),
            ("refusal_log_s", self.refusal_log_s, 0.0..=86_400.0),
        ]
    }
}
