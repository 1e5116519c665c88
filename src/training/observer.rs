//! What a stage tells while it runs.

use serde::Serialize;

use crate::driver::Scaling;
use crate::evaluation::Errors;

/// How far a stage is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Progress {
    /// From 1.
    pub epoch: u32,
    /// Updates done.
    pub update: u64,
    /// Updates in all.
    pub updates: u64,
    /// Loss of the last minibatch, without penalty.
    pub loss: f64,
    /// Consolidation penalty, λ included, at the weights before the last update.
    pub penalty: f64,
    /// Training events per second since the stage (re)started.
    pub events_per_s: f64,
}

impl Progress {
    /// Share of the updates done, 0–1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.update as f64 / self.updates.max(1) as f64
    }
}

/// How the network drives the validation events after an epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interim {
    /// Epochs done.
    pub epoch: u32,
    /// Closed loop, with the weights of that moment.
    pub errors: Errors,
}

/// What a stage tells while it runs, on the thread that called it. Who does not care is not asked to stop anything.
pub trait Observer {
    /// After every update. `false` stops the stage with [`LearnError::Stopped`](super::LearnError::Stopped).
    fn updated(&mut self, progress: &Progress) -> bool;
    /// After every update, before [`Self::updated`]: the weights as they are now. For whoever measures a stage on its way;
    /// such weights are never served.
    fn weights(&mut self, _progress: &Progress, _scaling: &Scaling, _weights: &[f32]) {}
    /// After every epoch, when there are validation events; and when a stage is resumed, what it told last.
    fn evaluated(&mut self, _interim: &Interim) {}
    /// Asked on the way through the validation events; `true` stops the stage as [`Self::updated`] does.
    fn wants_stop(&mut self) -> bool {
        false
    }
    /// Asked after every update: whether to be given a checkpoint now.
    fn wants_checkpoint(&mut self) -> bool {
        false
    }
    /// The checkpoint: opaque bytes for `resume`. Also given when the stage is stopped.
    fn checkpoint(&mut self, _progress: &Progress, _state: Vec<u8>) {}
}

/// Lets a stage run through, and looks at nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unwatched;

impl Observer for Unwatched {
    fn updated(&mut self, _: &Progress) -> bool {
        true
    }
}
