//! What a car-following event out of a whole road must be.

use serde::{Deserialize, Serialize};

/// Criteria of extraction, and how much of a road is held in memory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExtractionSettings {
    /// Shortest event, s: its steps times their length.
    pub min_duration_s: f64,
    /// Longest event, s: what follows on goes into events of its own.
    pub max_duration_s: f64,
    /// Least net spacing, m.
    pub min_spacing_m: f64,
    /// Largest net spacing, m.
    pub max_spacing_m: f64,
    /// Rows of a road held in memory at once, about 60 bytes each: all of them where vehicles come one after another (NGSIM),
    /// those of pairs that still follow each other where times do (SUMO).
    pub max_rows: u32,
}

impl Default for ExtractionSettings {
    fn default() -> Self {
        Self {
            min_duration_s: 15.0,
            max_duration_s: 60.0,
            min_spacing_m: 0.5,
            max_spacing_m: 120.0,
            max_rows: 4_000_000,
        }
    }
}

/// A criterion that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} = {value} is not within {low} to {high}")]
pub struct ExtractionSettingsError {
    /// Its name.
    pub name: &'static str,
    value: f64,
    low: f64,
    high: f64,
}

/// Longest duration and largest spacing that can be asked for, s and m.
const MAX_S: f64 = 3600.0;
const MAX_M: f64 = 10_000.0;

impl ExtractionSettings {
    /// Checks that every criterion is a number that makes sense.
    ///
    /// # Errors
    /// Names the first that does not.
    pub fn checked(self) -> Result<Self, ExtractionSettingsError> {
        for (name, value, low, high) in [
            ("max_duration_s", self.max_duration_s, 0.1, MAX_S),
            ("min_duration_s", self.min_duration_s, 0.0, self.max_duration_s),
            ("max_spacing_m", self.max_spacing_m, 0.0, MAX_M),
            ("min_spacing_m", self.min_spacing_m, 0.0, self.max_spacing_m),
            ("max_rows", self.max_rows.into(), 1.0, u32::MAX.into()),
        ] {
            if !(low..=high).contains(&value) {
                return Err(ExtractionSettingsError { name, value, low, high });
            }
        }
        Ok(self)
    }
}
