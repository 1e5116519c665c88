//! Whether the process runs, whether it can serve, and what it counts.

use std::sync::Arc;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;
use serde_json::json;

use super::AppState;
use super::answer::Answer;
use super::gate::Need;
use super::problem::{Code, Problem};
use crate::predictor::Degraded;

/// The process answers.
pub(super) async fn live() -> Answer {
    Answer::ok(&json!({"status": "ok"}))
}

/// The database can be written, and something answers for every model that has a live version. While an ancestor of a corrupt
/// version does, requests are still to be sent here: the list says for which models, to who may know of all of them.
pub(super) async fn ready(State(app): State<Arc<AppState>>, headers: HeaderMap) -> Result<Answer, Problem> {
    if *app.stopping.borrow() {
        return Err(Problem::busy(Code::ShuttingDown, "no new work is taken"));
    }
    if !app.predictor.ready() {
        return Err(Problem::busy(Code::NotReady, "a live version is not loaded, and no ancestor of it"));
    }
    app.store.look_at_writer().await?;
    let degraded = app.predictor.degraded();
    if degraded.is_empty() || app.gate.pass(&headers, Need::EveryModel, None).is_err() {
        return Ok(Answer::ok(&json!({"status": "ready"})));
    }
    let told = |of: &Degraded| json!({"model": of.model, "live": of.live, "serving": of.serving});
    Ok(Answer::ok(&json!({"status": "ready", "degraded": degraded.iter().map(told).collect::<Vec<_>>()})))
}

/// Prometheus text.
pub(super) async fn metrics(State(app): State<Arc<AppState>>) -> Result<impl IntoResponse, Problem> {
    for model in app.store.model_census().await? {
        app.metrics.model_state(&model);
        let (answering, corrupt) =
            (app.predictor.answering(model.model_id), app.store.corrupt_versions(model.model_id));
        app.metrics.integrity(&model.name, answering, corrupt);
        if !app.metrics.knows_driving(&model.name, model.live) {
            let regimes = match model.live {
                Some(live) => app.store.evaluation(model.model_id, live).await?,
                None => Vec::new(),
            };
            app.metrics.drives(&model.name, model.live, &regimes);
        }
    }
    app.metrics.database_size(app.store.size().await?);
    Ok(([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], app.metrics.render()))
}
