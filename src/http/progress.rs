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

use super::gate::Caller;
use super::path::{ModelAt, TaskAt, task_id};
use super::problem::{Code, Problem};
use super::tasks;
use super::{AppState, stopped};
use crate::lineage::{Model, RegimeName, Task, TaskState};
use crate::scheduler::TaskProgress;

/// `GET /v1/models/{model}/tasks/{task_id}/progress`
pub(super) async fn watch(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    TaskAt(task): TaskAt,
    caller: Caller,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let task = tasks::find(&app, &model, task).await?;
    let slot = Arc::clone(&app.stream_slots)
        .try_acquire_owned()
        .map_err(|_| Problem::busy(Code::Busy, "as many streams as the server keeps are open"))?;
    let watcher = Watcher::new(app, caller, model, &task, slot);
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
    told: Option<TaskProgress>,
    /// Waits behind the last of the progress before it.
    behind: Option<Event>,
    app: Arc<AppState>,
    caller: Caller,
    model: Model,
    task: i64,
    regime: RegimeName,
    _slot: OwnedSemaphorePermit,
}

impl Watcher {
    fn new(app: Arc<AppState>, caller: Caller, model: Model, task: &Task, slot: OwnedSemaphorePermit) -> Self {
        let mut timer = interval(Duration::from_secs_f64(app.settings.progress_interval_s));
        timer.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut changes = app.scheduler.changes();
        changes.mark_changed();
        let stopping = app.stopping.clone();
        Self {
            changes,
            stopping,
            progress: None,
            timer,
            shown: None,
            told: None,
            behind: None,
            app,
            caller,
            model,
            task: task.task_id,
            regime: task.regime.clone(),
            _slot: slot,
        }
    }

    /// The next event; `None` after a final state, when the key has ended, or when the server stops.
    async fn next(&mut self) -> Option<Event> {
        if self.behind.is_some() {
            return self.behind.take();
        }
        if self.shown.is_some_and(TaskState::is_final) {
            return None;
        }
        loop {
            if !self.app.gate.still_admits(&self.caller) {
                return None;
            }
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
        // What a task told last, such as how it drives after its last epoch, comes before its end.
        let last = self.advance();
        self.progress = self.app.scheduler.progress(self.task);
        let body = tasks::body(&self.app, &self.model, &task);
        let event = Event::default().event("task").data(body.to_string());
        if last.is_some() {
            self.behind = Some(event);
            return Some(last);
        }
        Some(Some(event))
    }

    fn advance(&mut self) -> Option<Event> {
        if self.progress.is_none() {
            self.progress = self.app.scheduler.progress(self.task);
        }
        let progress = *self.progress.as_ref()?.borrow();
        if self.told == Some(progress) {
            return None;
        }
        self.told = Some(progress);
        let update = progress.update?;
        let interim = progress.interim.map(|(epoch, measures)| {
            json!({
                "epoch": epoch,
                "regime": self.regime,
                "events": measures.events,
                "spacing_mse": measures.spacing_mse,
                "speed_mse": measures.speed_mse,
                "collision_rate_percent": 100.0 * f64::from(measures.collisions) / f64::from(measures.events.max(1)),
            })
        });
        let body = json!({
            "task_id": task_id(self.task),
            "progress": progress.share,
            "search": progress.search,
            "epoch": update.epoch,
            "update": update.update,
            "updates": update.updates,
            "loss": update.loss,
            "penalty": update.penalty,
            "events_per_s": update.events_per_s,
            "seconds_left": progress.seconds_left,
            "interim": interim,
        });
        Some(Event::default().event("progress").data(body.to_string()))
    }
}
