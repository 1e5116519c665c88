//! The scheduler's handle: what the rest of the server may ask of it, and its own loop.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use rayon::ThreadPool;
use tokio::sync::{Notify, watch};
use tokio::task::JoinError;
use tokio::time::MissedTickBehavior;

use super::learner::Learner;
use super::priority::step_back;
use super::running::{RunningTasks, TaskProgress};
use super::settings::SchedulerSettings;
use crate::predictor::Predictor;
use crate::store::Store;
use crate::training::{LearnError, Learned, Observer, StageInput};

/// Decides which task runs when. Cheap to clone; all clones are one scheduler.
#[derive(Clone)]
pub struct Scheduler(pub(super) Arc<Inner>);

pub(super) struct Inner {
    pub(super) settings: SchedulerSettings,
    pub(super) store: Arc<Store>,
    pub(super) predictor: Arc<Predictor>,
    pub(super) learner: Box<dyn Learner>,
    pub(super) workers: ThreadPool,
    pub(super) clock: fn() -> Timestamp,
    pub(super) running: RunningTasks,
    /// One turn at a time.
    pub(super) turn: tokio::sync::Mutex<()>,
    pub(super) changes: watch::Sender<u64>,
    wake: Notify,
    closing: watch::Sender<bool>,
}

impl fmt::Debug for Scheduler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Scheduler").field("settings", &self.0.settings).finish_non_exhaustive()
    }
}

impl Inner {
    /// Learns a stage from `checkpoint`; from the start when that one is of no use.
    pub(super) fn learn_or_afresh(
        &self,
        task_id: i64,
        input: &StageInput<'_>,
        checkpoint: Option<&[u8]>,
        observer: &mut dyn Observer,
    ) -> Result<Learned, LearnError> {
        match self.learner.learn(input, checkpoint, &self.workers, observer) {
            Err(LearnError::Checkpoint(detail)) if checkpoint.is_some() => {
                tracing::warn!(task_id, detail, "a checkpoint does not fit; the stage starts afresh");
                self.learner.learn(input, None, &self.workers, observer)
            }
            learned => learned,
        }
    }
}

impl Scheduler {
    /// A scheduler that nobody turns yet; see [`Self::run`] and [`Self::tick`]. `clock` is the system's, but in tests.
    ///
    /// # Errors
    /// When the training threads cannot be made.
    pub fn new(
        settings: SchedulerSettings,
        store: Arc<Store>,
        predictor: Arc<Predictor>,
        learner: Box<dyn Learner>,
        clock: fn() -> Timestamp,
    ) -> Result<Self, rayon::ThreadPoolBuildError> {
        let niceness = settings.niceness;
        let workers = rayon::ThreadPoolBuilder::new()
            .num_threads(settings.threads())
            .start_handler(move |_| step_back(niceness))
            .thread_name(|index| format!("training-{index}"))
            .build()?;
        Ok(Self(Arc::new(Inner {
            settings,
            store,
            predictor,
            learner,
            workers,
            clock,
            running: RunningTasks::default(),
            turn: tokio::sync::Mutex::new(()),
            changes: watch::Sender::new(0),
            wake: Notify::new(),
            closing: watch::Sender::new(false),
        })))
    }

    /// Runs `work` on a thread that steps back.
    pub(super) async fn compute<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Inner) -> T + Send + 'static,
    ) -> Result<T, JoinError> {
        let scheduler = self.clone();
        let computed = tokio::task::spawn_blocking(move || {
            step_back(scheduler.0.settings.niceness);
            work(&scheduler.0)
        });
        computed.await
    }

    /// How far what is not urgent steps back.
    #[must_use]
    pub fn niceness(&self) -> u8 {
        self.0.settings.niceness
    }

    /// Something changed that may let a task start, or ended one: to be called after every such commit.
    pub fn wake(&self) {
        self.0.changes.send_modify(|changes| *changes += 1);
        self.0.wake.notify_one();
    }

    /// Stops a task of this process at its next update, after the store was asked to cancel it (or a rollback did).
    pub fn cancel(&self, task_id: i64) {
        self.0.running.cancel(task_id);
        self.wake();
    }

    /// Stops the model's running task at its next update, after the store was told that the model is paused.
    pub fn hold(&self, model_id: i64) {
        self.0.running.hold(model_id);
        self.wake();
    }

    /// How far a task of this process is; none when it is not running here.
    #[must_use]
    pub fn progress(&self, task_id: i64) -> Option<watch::Receiver<TaskProgress>> {
        self.0.running.progress(task_id)
    }

    /// Changes whenever the state of some task may have: subscribe, read the task, wait, read again.
    #[must_use]
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.0.changes.subscribe()
    }

    /// Whether no task of this process runs.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.0.running.count() == 0
    }

    /// Waits until no task of this process runs.
    pub async fn settled(&self) {
        self.until(|running| running.count() == 0).await;
    }

    /// Waits until the task has left this process. A task whose end is stored does so within moments: then the version
    /// it made also serves, if it is to.
    pub async fn left(&self, task_id: i64) {
        self.until(|running| running.progress(task_id).is_none()).await;
    }

    async fn until(&self, reached: impl Fn(&RunningTasks) -> bool) {
        let mut changes = self.changes();
        while !reached(&self.0.running) {
            if changes.changed().await.is_err() {
                return;
            }
        }
    }

    /// Ends [`Self::run`]: running tasks save a checkpoint and go back in line.
    pub fn shut_down(&self) {
        self.0.closing.send_replace(true);
        self.0.running.hold_all();
    }

    /// Whether [`Self::shut_down`] was called.
    pub(super) fn is_closing(&self) -> bool {
        *self.0.closing.borrow()
    }

    /// Turns until [`Self::shut_down`], on every wake and every `trigger_interval_s`; then waits for the running tasks.
    pub async fn run(&self) {
        let mut closing = self.0.closing.subscribe();
        let mut timer = tokio::time::interval(Duration::from_secs_f64(self.0.settings.trigger_interval_s));
        timer.set_missed_tick_behavior(MissedTickBehavior::Delay);
        while !self.is_closing() {
            tokio::select! {
                _ = closing.changed() => break,
                _ = timer.tick() => {}
                () = self.0.wake.notified() => {}
            }
            if let Err(error) = self.tick().await {
                tracing::error!(%error, "the scheduler could not turn; it tries again");
            }
        }
        self.settled().await;
    }
}
