//! The tasks this process runs: how to stop one, and how far it is.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use tokio::sync::watch;

use crate::lineage::TestMeasures;
use crate::training::Progress;

/// Why a task is to stop at its next update. A cancel outweighs a hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub(super) enum StopReason {
    /// Its model is paused or the server shuts down: back in line, with a checkpoint.
    Hold = 1,
    /// Nobody wants it any more.
    Cancel = 2,
}

/// A wish to stop, from any thread.
#[derive(Debug, Default)]
pub(super) struct Stop(AtomicU8);

impl Stop {
    pub(super) fn ask(&self, reason: StopReason) {
        self.0.fetch_max(reason as u8, Ordering::AcqRel);
    }

    pub(super) fn asked(&self) -> Option<StopReason> {
        match self.0.load(Ordering::Acquire) {
            0 => None,
            1 => Some(StopReason::Hold),
            _ => Some(StopReason::Cancel),
        }
    }
}

/// How far a running task is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaskProgress {
    /// Share done, 0–1.
    pub share: f64,
    /// Of the stage under way; none before the first update.
    pub update: Option<Progress>,
    /// Which stage of a search for a strength that is; none where nothing is searched.
    pub search: Option<SearchPlace>,
    /// At the present rate, s; none before the first update.
    pub seconds_left: Option<f64>,
    /// Epochs done, and how the network drove the task's validation events after the last of them.
    pub interim: Option<(u32, TestMeasures)>,
}

impl TaskProgress {
    /// Of a task that has done `share` of its updates.
    pub(super) fn started(share: f64) -> Self {
        Self { share, update: None, search: None, seconds_left: None, interim: None }
    }
}

/// Where a search for a strength is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SearchPlace {
    /// The stage under way, from 1: the one without a penalty, the candidates, the one that is kept.
    pub learning: u32,
    /// Stages in all.
    pub of: u32,
    /// Its strength; 0 without a penalty.
    pub strength: f64,
}

/// A task of this process.
#[derive(Debug, Clone)]
pub(super) struct Running {
    pub(super) model_id: i64,
    pub(super) stop: Arc<Stop>,
    pub(super) progress: watch::Sender<TaskProgress>,
}

/// All tasks of this process, by id.
#[derive(Debug, Default)]
pub(super) struct RunningTasks(Mutex<HashMap<i64, Running>>);

impl RunningTasks {
    fn lock(&self) -> MutexGuard<'_, HashMap<i64, Running>> {
        // The map is whole between any two of its calls, so a panic elsewhere leaves it usable.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reserves a place before the task is started in the database, so that no wish to stop it is missed in between. It
    /// has done `share` of its updates.
    pub(super) fn reserve(&self, task_id: i64, model_id: i64, share: f64) -> Running {
        let (progress, _) = watch::channel(TaskProgress::started(share));
        let running = Running { model_id, stop: Arc::default(), progress };
        self.lock().insert(task_id, running.clone());
        running
    }

    pub(super) fn release(&self, task_id: i64) {
        self.lock().remove(&task_id);
    }

    pub(super) fn count(&self) -> usize {
        self.lock().len()
    }

    pub(super) fn has_model(&self, model_id: i64) -> bool {
        self.lock().values().any(|running| running.model_id == model_id)
    }

    pub(super) fn cancel(&self, task_id: i64) {
        if let Some(running) = self.lock().get(&task_id) {
            running.stop.ask(StopReason::Cancel);
        }
    }

    pub(super) fn hold(&self, model_id: i64) {
        for running in self.lock().values().filter(|running| running.model_id == model_id) {
            running.stop.ask(StopReason::Hold);
        }
    }

    pub(super) fn hold_all(&self) {
        for running in self.lock().values() {
            running.stop.ask(StopReason::Hold);
        }
    }

    pub(super) fn progress(&self, task_id: i64) -> Option<watch::Receiver<TaskProgress>> {
        self.lock().get(&task_id).map(|running| running.progress.subscribe())
    }
}
