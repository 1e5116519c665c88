//! What goes: content that is to be erased, what retention does not keep, and pages that nothing uses any more.
//!
//! All of it in small steps, each a transaction of its own, so that whoever wants to write waits for one step at most; a
//! step that a crash undoes is done again.

mod settings;

use std::sync::Arc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use tokio::sync::watch;
use tokio::time::MissedTickBehavior;

pub use settings::UpkeepSettings;

use crate::consolidation::Method;
use crate::lineage::{Model, Retention};
use crate::predictor::Predictor;
use crate::scheduler::Scheduler;
use crate::store::{Store, StoreError};

/// Models read at once.
const MODELS_AT_ONCE: u32 = 256;

/// Whether a model does without the events it has learned: its method does not go back to them, nor does a search for its
/// strength.
fn forgets_events(model: &Model) -> bool {
    let goes_back = model.method == Method::Joint || model.method.replays();
    !goes_back && !model.settings.searches_strength(model.method)
}

/// Takes away what is to go.
#[derive(Debug, Clone)]
pub struct Upkeep {
    store: Arc<Store>,
    scheduler: Scheduler,
    predictor: Arc<Predictor>,
    settings: UpkeepSettings,
}

impl Upkeep {
    /// Nothing happens before [`Self::run`].
    #[must_use]
    pub fn new(store: Arc<Store>, scheduler: Scheduler, predictor: Arc<Predictor>, settings: UpkeepSettings) -> Self {
        Self { store, scheduler, predictor, settings }
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
            self.store.keep_log_short().await?;
            let models = self.models().await?;
            for model in &models {
                self.retain(model).await?;
            }
            self.keep_within_budget(&models).await?;
            self.give_back().await?;
        }
        Ok(())
    }

    async fn models(&self) -> Result<Vec<Model>, StoreError> {
        let mut models: Vec<Model> = Vec::new();
        loop {
            let after = models.last().map_or(0, |model| model.model_id);
            let page = self.store.models(after, MODELS_AT_ONCE).await?;
            if page.is_empty() {
                return Ok(models);
            }
            models.extend(page);
        }
    }

    /// Drops what a model's retention does not keep.
    async fn retain(&self, model: &Model) -> Result<(), StoreError> {
        let now = Timestamp::now();
        let Retention { events_s, versions } = model.settings.retention;
        if let Some(kept_s) = events_s.filter(|_| forgets_events(model)) {
            let before = now.saturating_sub(SignedDuration::from_secs(kept_s.into())).unwrap_or(Timestamp::MIN);
            let mut events = 0;
            loop {
                let pruned =
                    self.store.prune_events(model.model_id, Some(before), self.settings.rows_at_once, now).await?;
                if pruned == 0 {
                    break;
                }
                events += pruned;
            }
            if events > 0 {
                tracing::info!(model = %model.name, events, "the arrays of old events were dropped");
            }
        }
        if let Some(keep) = versions {
            while let Some(version) = self.store.prune_version(model.model_id, keep, now).await? {
                self.predictor.forget(model.model_id, version);
                tracing::info!(model = %model.name, version, "the weights of an old version were dropped");
            }
        }
        Ok(())
    }

    /// Drops arrays of the oldest learned events of each model in turn, until the database uses no more than it may.
    async fn keep_within_budget(&self, models: &[Model]) -> Result<(), StoreError> {
        let budget = self.settings.budget_bytes;
        if budget == 0 {
            return Ok(());
        }
        let mut events = 0;
        while self.store.used_bytes().await? > budget {
            let mut pruned = 0;
            for model in models.iter().filter(|model| forgets_events(model)) {
                pruned +=
                    self.store.prune_events(model.model_id, None, self.settings.rows_at_once, Timestamp::now()).await?;
            }
            events += pruned;
            if pruned == 0 {
                tracing::warn!(
                    budget_bytes = budget,
                    "the database uses more than its budget, and nothing is left to drop"
                );
                break;
            }
        }
        if events > 0 {
            tracing::warn!(
                events,
                budget_bytes = budget,
                "the arrays of old events were dropped to keep to the budget"
            );
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
