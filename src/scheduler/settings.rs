//! Settings of the scheduler.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

/// Threads that train unless somebody asks for more. Each holds the network's states of the events it drives, and an update
/// of 32 events is two pieces of 16: more threads would take memory and wait.
pub const MOST_THREADS: usize = 4;

/// Half of the cores, so that the rest serves.
fn threads_for(cores: usize) -> usize {
    (cores / 2).clamp(1, MOST_THREADS)
}

/// How much trains at once, and how often what is looked at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SchedulerSettings {
    /// Tasks that run at once, of different models.
    pub parallel_tasks: usize,
    /// Threads that train, shared by these; 0 takes half of the cores, at most [`MOST_THREADS`].
    pub training_threads: usize,
    /// Niceness of everything a task does, 0 to 19: the greater, the less it gets of cores that others want as well.
    pub niceness: u8,
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
            0 => threads_for(std::thread::available_parallelism().map_or(1, usize::from)),
            threads => threads,
        }
    }

    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 6] {
        [
            ("parallel_tasks", self.parallel_tasks as f64, 1.0..=64.0),
            ("training_threads", self.training_threads as f64, 0.0..=1024.0),
            ("niceness", self.niceness.into(), 0.0..=19.0),
            ("checkpoint_s", self.checkpoint_s, 0.0..=86_400.0),
            ("trigger_interval_s", self.trigger_interval_s, 0.01..=3600.0),
            ("max_crashes", self.max_crashes.into(), 0.0..=1e6),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_cores_do_not_mean_many_states_in_memory() {
        assert_eq!([1, 2, 4, 6, 8, 128].map(threads_for), [1, 1, 2, 3, 4, 4]);
    }
}
