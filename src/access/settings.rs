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
}

impl AccessSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 1] {
        [("max_keys", self.max_keys.into(), 1.0..=1e6)]
    }
}
