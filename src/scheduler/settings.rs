//! Settings of the scheduler.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

/// How much trains at once, and how often what is looked at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SchedulerSettings {
    /// Tasks that run at once, of different models.
    pub parallel_tasks: usize,
    /// Threads that train, shared by these; 0 takes half of the cores.
    pub training_threads: usize,
    /// A running task saves a checkpoint this often, s.
    pub checkpoint_s: f64,
    /// How often schedules by age are looked at, s.
    pub trigger_interval_s: f64,
    /// A task whose process died more often than this without a checkpoint in between fails.
    pub max_crashes: u32,
}

impl SchedulerSettings {
    /// The number of training threads, at least one.
    #[must_use]
    pub fn threads(&self) -> usize {
        match self.training_threads {
            0 => std::thread::available_parallelism().map_or(1, |cores| (cores.get() / 2).max(1)),
            threads => threads,
        }
    }

    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 5] {
        [
            ("parallel_tasks", self.parallel_tasks as f64, 1.0..=64.0),
            ("training_threads", self.training_threads as f64, 0.0..=1024.0),
            ("checkpoint_s", self.checkpoint_s, 0.0..=86_400.0),
            ("trigger_interval_s", self.trigger_interval_s, 0.01..=3600.0),
            ("max_crashes", self.max_crashes.into(), 0.0..=1e6),
        ]
    }
}
