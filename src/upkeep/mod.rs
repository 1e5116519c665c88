//! What goes: content that is to be erased, what retention does not keep, and pages that nothing uses any more.
//!
//! All of it in small steps, each a transaction of its own, so that whoever wants to write waits for one step at most; a
//! step that a crash undoes is done again.

mod settings;

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::watch;
use tokio::time::MissedTickBehavior;

pub use settings::UpkeepSettings;

use crate::scheduler::Scheduler;
use crate::store::{Store, StoreError};

/// Takes away what is to go.
#[derive(Debug, Clone)]
pub struct Upkeep {
    store: Arc<Store>,
    scheduler: Scheduler,
    settings: UpkeepSettings,
}

impl Upkeep {
    /// Nothing happens before [`Self::run`].
    #[must_use]
    pub fn new(store: Arc<Store>, scheduler: Scheduler, settings: UpkeepSettings) -> Self {
        Self { store, scheduler, settings }
    }

    /// Turns on every change the scheduler is woken for and every `interval_s`, until told to stop.
    pub async fn run(self, mut stopping: watch::Receiver<bool>) {
        let mut changes = self.scheduler.changes();
        let mut timer = tokio::time::interval(Duration::from_secs_f64(self.settings.interval_s));
        timer.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let timed = tokio::select! {
                changed = changes.changed() => if changed.is_err() { return } else { false },
                _ = timer.tick() => true,
                _ = stopping.wait_for(|&stop| stop) => return,
            };
            // What is under way is dropped between two steps, or with a step that then never happened.
            let turned = tokio::select! {
                turned = self.turn(timed) => turned,
                _ = stopping.wait_for(|&stop| stop) => return,
            };
            if let Err(error) = turned {
                tracing::warn!(%error, "what is to go stays for now; it is tried again");
            }
        }
    }

    /// What was asked for; where `timed`, also what goes by itself.
    ///
    /// # Errors
    /// When the database cannot be read or written; what went before that is gone.
    async fn turn(&self, timed: bool) -> Result<(), StoreError> {
        while let Some(batch_id) = self.store.batch_to_erase().await? {
            if !self.erase(batch_id).await? {
                break;
            }
        }
        if timed {
            self.give_back().await?;
        }
        Ok(())
    }

    /// Erases a batch's content. `false` when a reader kept the write-ahead log from being emptied: it is tried again.
    async fn erase(&self, batch_id: i64) -> Result<bool, StoreError> {
        let limit = self.settings.rows_at_once;
        let mut from = 0;
        while let Some(next) = self.store.erase_events(batch_id, from, limit).await? {
            from = next;
        }
        from = 0;
        while let Some(next) = self.store.erase_words(batch_id, from, limit).await? {
            from = next;
        }
        let folded = self.store.fold_log().await?;
        if folded {
            self.store.note_erased(batch_id, Timestamp::now()).await?;
            tracing::info!(batch_id, "the content of a retracted batch is erased");
        }
        Ok(folded)
    }

    /// Gives unused pages back to the file system as long as no task runs.
    async fn give_back(&self) -> Result<(), StoreError> {
        while self.scheduler.is_idle() && self.store.unused_pages().await? > self.settings.spare_pages.into() {
            if !self.store.give_back(self.settings.pages_at_once).await? {
                break;
            }
        }
        Ok(())
    }
}
