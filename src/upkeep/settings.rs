//! Settings of what goes.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

/// How much goes at once, and how often it is looked at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UpkeepSettings {
    /// How often it is looked at what may go, s; what somebody asked for is looked at once.
    pub interval_s: f64,
    /// Rows changed in one transaction.
    pub rows_at_once: u32,
    /// Unused pages given back to the file system in one transaction, while no task runs.
    pub pages_at_once: u32,
    /// Unused pages that are kept for what comes next.
    pub spare_pages: u32,
    /// Bytes that the database may use before arrays of the oldest learned events go, whatever retention says; 0 for no end.
    pub budget_bytes: u64,
}

impl UpkeepSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 5] {
        [
            ("interval_s", self.interval_s, 0.01..=86_400.0),
            ("rows_at_once", self.rows_at_once.into(), 1.0..=100_000.0),
            ("pages_at_once", self.pages_at_once.into(), 1.0..=1_000_000.0),
            ("spare_pages", self.spare_pages.into(), 0.0..=4e9),
            ("budget_bytes", self.budget_bytes as f64, 0.0..=1e15),
        ]
    }
}
