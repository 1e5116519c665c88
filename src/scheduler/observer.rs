//! What a running stage tells: progress to whoever watches, checkpoints to the store; and what it is told: to stop.

use std::sync::Arc;
use std::time::{Duration, Instant};

use jiff::Timestamp;
use tokio::runtime::Handle;

use super::handle::Scheduler;
use super::running::{Running, SearchPlace, StopReason, TaskProgress};
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
    /// When the first update of this attempt was done, and the share done by then.
    first: Option<(Instant, f64)>,
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

    /// Tells how far the task is; whether to go on.
    pub(super) fn tell(&mut self, share: f64, progress: &Progress, search: Option<SearchPlace>) -> bool {
        let seconds_left = self.seconds_left(share);
        self.running.progress.send_modify(|told| {
            *told = TaskProgress { share, update: Some(*progress), search, seconds_left, interim: told.interim };
        });
        self.running.stop.asked().is_none()
    }

    fn seconds_left(&mut self, share: f64) -> Option<f64> {
        let (since, first) = *self.first.get_or_insert((Instant::now(), share));
        let done = Some(share - first).filter(|&done| done > 0.0)?;
        Some(since.elapsed().as_secs_f64() / done * (1.0 - share))
    }

    /// Saves the task's checkpoint, unless nobody wants it any more.
    pub(super) fn save(&mut self, share: f64, state: &[u8]) {
        if self.running.stop.asked() == Some(StopReason::Cancel) {
            return;
        }
        let saved = self.store.save_checkpoint(self.task_id, share, state, (self.clock)());
        if let Err(error) = self.runtime.block_on(saved) {
            // The task is not worse off than before: it goes on, and would resume from the checkpoint before.
            tracing::warn!(task_id = self.task_id, %error, "a checkpoint could not be saved");
        }
        self.last_checkpoint = Instant::now();
    }
}

impl Observer for JobObserver {
    fn updated(&mut self, progress: &Progress) -> bool {
        self.tell(progress.share(), progress, None)
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
        self.save(progress.share(), &state);
    }
}
