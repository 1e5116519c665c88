//! Whether the process runs, whether it can serve, and what it counts.

use std::sync::Arc;

use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;
use serde_json::json;

use super::AppState;
use super::answer::Answer;
use super::problem::{Code, Problem};

/// The process answers.
pub(super) async fn live() -> Answer {
    Answer::ok(&json!({"status": "ok"}))
}

/// The database can be written.
pub(super) async fn ready(State(app): State<Arc<AppState>>) -> Result<Answer, Problem> {
    if *app.stopping.borrow() {
        return Err(Problem::busy(Code::ShuttingDown, "no new work is taken"));
    }
    if !app.predictor.ready() {
        return Err(Problem::busy(Code::NotReady, "a live version is not loaded"));
    }
    // Beginning a write takes the lock that any write takes; dropped, it never happened.
    drop(app.store.begin().await?);
    Ok(Answer::ok(&json!({"status": "ready"})))
}

/// Prometheus text.
pub(super) async fn metrics(State(app): State<Arc<AppState>>) -> Result<impl IntoResponse, Problem> {
    for model in app.store.model_census().await? {
        app.metrics.model_state(&model.name, model.live, model.queued, model.running);
    }
    Ok(([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], app.metrics.render()))
}
