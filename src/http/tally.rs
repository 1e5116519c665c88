//! Counts tasks as they end, for the metrics.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::AppState;
use crate::lineage::{Task, TaskKind};
use crate::store::StoreError;

/// Counts until the server stops, and then what ended meanwhile.
pub async fn run(app: Arc<AppState>) {
    let (mut changes, mut stopping) = (app.scheduler.changes(), app.stopping.clone());
    let mut tally = Tally::default();
    match app.store.last_task().await {
        Ok(last) => tally.last = last,
        Err(error) => tracing::error!(%error, "tasks are not counted"),
    }
    loop {
        if let Err(error) = tally.count(&app).await {
            tracing::warn!(%error, "tasks could not be counted; they are counted later");
        }
        tokio::select! {
            changed = changes.changed() => if changed.is_err() { return },
            _ = stopping.wait_for(|&stop| stop) => return,
        }
    }
}

#[derive(Debug, Default)]
struct Tally {
    /// Tasks that had not ended when last looked at: rows of tasks and models.
    open: BTreeSet<(i64, i64)>,
    last: i64,
}

impl Tally {
    async fn count(&mut self, app: &AppState) -> Result<(), StoreError> {
        self.open.extend(app.store.unended_tasks(self.last).await?);
        self.last = self.open.last().map_or(self.last, |&(task_id, _)| self.last.max(task_id));
        for (task_id, model_id) in self.open.clone() {
            match app.store.task(model_id, task_id).await? {
                Some(task) if !task.state.is_final() => {}
                Some(task) => {
                    record(app, &task).await?;
                    self.open.remove(&(task_id, model_id));
                }
                None => drop(self.open.remove(&(task_id, model_id))),
            }
        }
        Ok(())
    }
}

async fn record(app: &AppState, task: &Task) -> Result<(), StoreError> {
    let model = app.store.model_by_id(task.model_id).await?;
    let version = match task.version {
        Some(version) => app.store.version(task.model_id, version).await?,
        None => None,
    };
    let elapsed = match (task.started_at, task.ended_at) {
        (Some(started), Some(ended)) => ended.duration_since(started).unsigned_abs(),
        _ => std::time::Duration::ZERO,
    };
    // What a replay ends with was made by its parts.
    let events = version.filter(|_| task.kind == TaskKind::Learn).map_or(0, |version| version.train_events);
    app.metrics.task_ended(model.name.as_str(), task.state.as_str(), elapsed, events);
    Ok(())
}
