//! What a running stage tells: progress to whoever watches, checkpoints to the store; and what it is told: to stop.

use std::sync::Arc;
use std::time::{Duration, Instant};

use jiff::Timestamp;
use tokio::runtime::Handle;

use super::handle::Scheduler;
use super::running::{Running, StopReason, TaskProgress};
use crate::lineage::TestMeasures;
use crate::store::Store;
use crate::training::{Interim, Observer, Progress};

/// Lives on the blocking thread that learns.
pub(super) struct JobObserver {
    task_id: i64,
    running: Running,
    store: Arc<Store>,
    runtime: Handle,
    clock: fn() -> Timestamp,
    checkpoint_every: Duration,
    last_checkpoint: Instant,
    /// When the first update of this attempt was done, and its number.
    first: Option<(Instant, u64)>,
}

impl JobObserver {
    /// To be made on the runtime.
    pub(super) fn new(scheduler: &Scheduler, task_id: i64, running: Running) -> Self {
        Self {
            task_id,
            running,
            store: Arc::clone(&scheduler.0.store),
            runtime: Handle::current(),
            clock: scheduler.0.clock,
            checkpoint_every: Duration::from_secs_f64(scheduler.0.settings.checkpoint_s),
            last_checkpoint: Instant::now(),
            first: None,
        }
    }

    fn seconds_left(&mut self, progress: &Progress) -> Option<f64> {
        let (since, first) = *self.first.get_or_insert((Instant::now(), progress.update));
        let done = progress.update.checked_sub(first).filter(|&done| done > 0)?;
        let left = progress.updates.saturating_sub(progress.update);
        Some(since.elapsed().as_secs_f64() / done as f64 * left as f64)
    }
}

fn share(progress: &Progress) -> f64 {
    progress.update as f64 / progress.updates.max(1) as f64
}

impl Observer for JobObserver {
    fn updated(&mut self, progress: &Progress) -> bool {
        let seconds_left = self.seconds_left(progress);
        self.running.progress.send_modify(|told| {
            *told =
                TaskProgress { share: share(progress), update: Some(*progress), seconds_left, interim: told.interim };
        });
        self.running.stop.asked().is_none()
    }

    fn evaluated(&mut self, interim: &Interim) {
        let measures = TestMeasures::of(&interim.errors);
        self.running.progress.send_modify(|told| told.interim = measures.map(|measures| (interim.epoch, measures)));
    }

    fn wants_stop(&mut self) -> bool {
        self.running.stop.asked().is_some()
    }

    fn wants_checkpoint(&mut self) -> bool {
        self.last_checkpoint.elapsed() >= self.checkpoint_every
    }

    fn checkpoint(&mut self, progress: &Progress, state: Vec<u8>) {
        if self.running.stop.asked() == Some(StopReason::Cancel) {
            return;
        }
        let saved = self.store.save_checkpoint(self.task_id, share(progress), &state, (self.clock)());
        if let Err(error) = self.runtime.block_on(saved) {
            // The task is not worse off than before: it goes on, and would resume from the checkpoint before.
            tracing::warn!(task_id = self.task_id, %error, "a checkpoint could not be saved");
        }
        self.last_checkpoint = Instant::now();
    }
}
