//! Settings of the predictor.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::evaluation::CalibrationSettings;

/// How much is computed to answer how versions and reference drivers drive given events.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialSettings {
    /// Threads that drive, shared by all requests.
    pub threads: usize,
    /// Steps of the accepted events of one request.
    pub max_steps: u64,
    /// Versions of one request.
    pub max_versions: usize,
    /// How reference drivers are calibrated.
    pub calibration: CalibrationSettings,
}

impl TrialSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 8] {
        let calibration = &self.calibration;
        [
            ("threads", self.threads as f64, 1.0..=1024.0),
            ("max_steps", self.max_steps as f64, 1.0..=1e9),
            ("max_versions", self.max_versions as f64, 1.0..=1000.0),
            ("calibration.evaluations", calibration.evaluations.into(), 1.0..=1e6),
            ("calibration.max_events", calibration.max_events as f64, 0.0..=1e6),
            ("calibration.max_steps", calibration.max_steps as f64, 0.0..=1e9),
            ("calibration.collision_penalty", calibration.collision_penalty, 0.0..=1e9),
            ("calibration.seed", calibration.seed as f64, 0.0..=1e18),
        ]
    }
}

/// How much is kept loaded, and what is computed where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictorSettings {
    /// Versions kept loaded beside the live ones, because somebody named them.
    pub named_versions: usize,
    /// Requests of up to so many windows or steps are computed where they arrive, larger ones on threads of their own.
    pub inline_windows: usize,
    /// Windows of small requests that wait to be computed together.
    pub waiting_windows: usize,
    /// Threads that compute large requests, shared by all of them; 0 takes as many as there are cores.
    pub threads: usize,
    /// Vehicles that are answered step by step at once.
    pub sequences: usize,
    /// A vehicle of which no step comes for so long has ended, s.
    pub sequence_idle_s: f64,
}

impl PredictorSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 6] {
        [
            ("named_versions", self.named_versions as f64, 0.0..=10_000.0),
            ("inline_windows", self.inline_windows as f64, 0.0..=1e6),
            ("waiting_windows", self.waiting_windows as f64, 1.0..=1e6),
            ("threads", self.threads as f64, 0.0..=1024.0),
            ("sequences", self.sequences as f64, 0.0..=1e7),
            ("sequence_idle_s", self.sequence_idle_s, 0.01..=86_400.0),
        ]
    }

    /// Threads that compute large requests.
    #[must_use]
    pub fn threads(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        }
    }
}
