//! A task's progress as server-sent events.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::response::Sse;
use axum::response::sse::{Event, KeepAlive};
use futures_util::Stream;
use serde_json::json;
use tokio::sync::{OwnedSemaphorePermit, watch};
use tokio::time::{Interval, MissedTickBehavior, interval};

use super::path::{ModelAt, TaskAt, task_id};
use super::problem::{Code, Problem};
use super::tasks;
use super::{AppState, stopped};
use crate::lineage::{Model, TaskState};
use crate::scheduler::TaskProgress;

/// `GET /v1/models/{model}/tasks/{task_id}/progress`
pub(super) async fn watch(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    TaskAt(task): TaskAt,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    tasks::find(&app, &model, task).await?;
    let slot = Arc::clone(&app.stream_slots)
        .try_acquire_owned()
        .map_err(|_| Problem::busy(Code::Busy, "as many streams as the server keeps are open"))?;
    let watcher = Watcher::new(app, model, task, slot);
    let events = futures_util::stream::unfold(watcher, |mut watcher| async move {
        let event = watcher.next().await?;
        Some((Ok(event), watcher))
    });
    Ok(Sse::new(events).keep_alive(KeepAlive::default()))
}

struct Watcher {
    changes: watch::Receiver<u64>,
    stopping: watch::Receiver<bool>,
    progress: Option<watch::Receiver<TaskProgress>>,
    timer: Interval,
    shown: Option<TaskState>,
    app: Arc<AppState>,
    model: Model,
    task: i64,
    _slot: OwnedSemaphorePermit,
}

impl Watcher {
    fn new(app: Arc<AppState>, model: Model, task: i64, slot: OwnedSemaphorePermit) -> Self {
        let mut timer = interval(Duration::from_secs_f64(app.settings.progress_interval_s));
        timer.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut changes = app.scheduler.changes();
        changes.mark_changed();
        let stopping = app.stopping.clone();
        Self { changes, stopping, progress: None, timer, shown: None, app, model, task, _slot: slot }
    }

    /// The next event; `None` after a final state, or when the server stops.
    async fn next(&mut self) -> Option<Event> {
        if self.shown.is_some_and(TaskState::is_final) {
            return None;
        }
        loop {
            tokio::select! {
                changed = self.changes.changed() => {
                    changed.ok()?;
                    if let Some(event) = self.state_change().await? {
                        return Some(event);
                    }
                }
                _ = self.timer.tick() => {
                    if let Some(event) = self.advance() {
                        return Some(event);
                    }
                }
                () = stopped(&mut self.stopping) => return None,
            }
        }
    }

    async fn state_change(&mut self) -> Option<Option<Event>> {
        let task = tasks::find(&self.app, &self.model, self.task).await.ok()?;
        if self.shown == Some(task.state) {
            return Some(None);
        }
        self.shown = Some(task.state);
        self.progress = None;
        let body = tasks::body(&self.app, &self.model, &task);
        Some(Some(Event::default().event("task").data(body.to_string())))
    }

    fn advance(&mut self) -> Option<Event> {
        if self.progress.is_none() {
            self.progress = self.app.scheduler.progress(self.task);
        }
        let progress = self.progress.as_mut()?;
        if !progress.has_changed().unwrap_or(false) {
            return None;
        }
        let progress = *progress.borrow_and_update();
        let update = progress.update?;
        let body = json!({
            "task_id": task_id(self.task),
            "progress": progress.share,
            "epoch": update.epoch,
            "update": update.update,
            "updates": update.updates,
            "loss": update.loss,
            "penalty": update.penalty,
            "events_per_s": update.events_per_s,
            "seconds_left": progress.seconds_left,
        });
        Some(Event::default().event("progress").data(body.to_string()))
    }
}
