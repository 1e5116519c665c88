//! `/v1/models/{model}/sources`: where events come from, and releasing what is held.

use std::sync::Arc;

use axum::extract::State;
use jiff::Timestamp;
use serde_json::{Value, json};

use super::AppState;
use super::answer::Answer;
use super::path::{ModelAt, SourceAt, task_id};
use super::problem::{Code, Problem};
use super::query::Page;
use crate::store::source::{self, Source};
use crate::store::{Actor, selection};

fn body(source: &Source) -> Value {
    json!({
        "source": source.name,
        "held": source.held_at.is_some(),
        "held_at": source.held_at.map(|at| at.to_string()),
        "reason": source.reason,
        "released_at": source.released_at.map(|at| at.to_string()),
        "checked_events": source.outcomes.len(),
        "failed_events": source.outcomes.bytes().filter(|&outcome| outcome == b'0').count(),
        "held_events": source.held_events,
    })
}

/// `GET /v1/models/{model}/sources`
pub(super) async fn list(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    page: Page,
) -> Result<Answer, Problem> {
    let sources = app.store.sources(model.model_id, page.after, page.fetch()).await?;
    Ok(Answer::ok(&page.body("sources", sources, |source| source.source_id, body)))
}

/// `POST /v1/models/{model}/sources/{source}/release`
pub(super) async fn release(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    SourceAt(name): SourceAt,
    by: Actor,
) -> Result<Answer, Problem> {
    let missing = || Code::SourceNotFound.because(format!("{} knows no source {name:?}", model.name));
    let mut tx = app.store.begin_for(&by).await?;
    let now = Timestamp::now();
    source::get(&mut tx, model.model_id, &name).await?.ok_or_else(missing)?;
    let released = source::release(&mut tx, model.model_id, &name, now).await?;
    let tasks = selection::create_due(&mut tx, model.model_id, model.settings.schedule, now).await?;
    let after = source::get(&mut tx, model.model_id, &name).await?.ok_or_else(missing)?;
    tx.commit().await?;
    app.scheduler.wake();
    if let Some(events) = released {
        tracing::info!(model = %model.name, source = name, events, "a source was released");
    }
    let mut shown = body(&after);
    shown["released_events"] = json!(released.unwrap_or_default());
    shown["task_ids"] = tasks.iter().map(|&task| task_id(task)).collect();
    Ok(Answer::ok(&shown))
}
