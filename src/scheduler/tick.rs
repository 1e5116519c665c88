//! One turn of the scheduler.

use super::handle::Scheduler;
use super::{job, triggers};
use crate::store::StoreError;
use crate::store::task::{self, Candidate, Start};

/// What one turn did.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TickOutcome {
    /// Tasks that schedules made.
    pub triggered: Vec<i64>,
    /// Tasks that were started or resumed.
    pub started: Vec<i64>,
    /// Tasks that run in this process now.
    pub running: usize,
}

impl TickOutcome {
    /// Whether nothing happens until something else does.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.running == 0
    }
}

impl Scheduler {
    /// Puts tasks that an earlier process left running back in line; to be called once, before the first turn and before
    /// anybody is answered.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn take_over(&self) -> Result<(), StoreError> {
        let mut transaction = self.0.store.begin().await?;
        let left = task::take_over(&mut transaction, (self.0.clock)()).await?;
        transaction.commit().await?;
        if !left.is_empty() {
            tracing::warn!(tasks = ?left, "an earlier process ended while these tasks ran; they go on from their checkpoints");
        }
        Ok(())
    }

    /// Makes the tasks that are due and starts what may start. Does not wait for them to end.
    ///
    /// # Errors
    /// When the database cannot be read or written; what was started before that goes on.
    pub async fn tick(&self) -> Result<TickOutcome, StoreError> {
        let _one_at_a_time = self.0.turn.lock().await;
        let triggered = triggers::create_due(&self.0.store, (self.0.clock)()).await?;
        let mut started = Vec::new();
        while !self.is_closing() && self.0.running.count() < self.0.settings.parallel_tasks {
            let candidates = self.0.store.candidates().await?;
            let Some(next) = candidates.into_iter().find(|one| !self.0.running.has_model(one.model_id)) else { break };
            started.extend(self.start(next).await?);
        }
        Ok(TickOutcome { triggered, started, running: self.0.running.count() })
    }

    /// Starts one task; none when it was not to be started after all.
    async fn start(&self, candidate: Candidate) -> Result<Option<i64>, StoreError> {
        let Candidate { task_id, model_id, checkpointed } = candidate;
        let running = self.0.running.reserve(task_id, model_id, checkpointed);
        match self.start_in_store(task_id).await {
            Ok(Start::Running(task)) => {
                tokio::spawn(job::supervise(self.clone(), *task, running));
                Ok(Some(task_id))
            }
            not_started => {
                self.0.running.release(task_id);
                not_started?;
                self.0.changes.send_modify(|changes| *changes += 1);
                Ok(None)
            }
        }
    }

    async fn start_in_store(&self, task_id: i64) -> Result<Start, StoreError> {
        let mut transaction = self.0.store.begin().await?;
        let start = task::start(&mut transaction, task_id, self.0.settings.max_crashes, (self.0.clock)()).await?;
        transaction.commit().await?;
        Ok(start)
    }
}
