//! `/v1/models`: create and read lineages; hold and release their training.

use std::sync::Arc;

use axum::extract::State;
use axum::http::header::{ETAG, LOCATION};
use axum::http::{HeaderMap, StatusCode};
use serde::Deserialize;
use serde_json::{Value, json};

use super::AppState;
use super::answer::Answer;
use super::body::{Json, JsonBody};
use super::etag::{check_if_match, etag};
use super::fork::{self, Origin};
use super::gate::Caller;
use super::idempotency::Repeatable;
use super::object::Object;
use super::once::Once;
use super::path::ModelAt;
use super::problem::{Code, Problem};
use super::query::Page;
use crate::consolidation::Method;
use crate::lineage::{Model, ModelName, ModelSettings, Retention};
use crate::store::copy::Fork;
use crate::store::{Actor, WriteTransaction, model};

/// The body of a creation.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NewModel {
    model: ModelName,
    method: Method,
    #[serde(default)]
    settings: Once,
    from: Option<Object<Origin>>,
}

impl NewModel {
    /// The model's settings: those that are given, and `defaults` for the rest.
    pub(super) fn settings(&self, defaults: &ModelSettings) -> Result<ModelSettings, Problem> {
        let settings = defaults.overridden(&self.settings.0)?;
        settings.check_for(self.method)?;
        Ok(settings)
    }
}

/// The body of a change.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Change {
    retention: Once,
}

impl Change {
    /// What is kept from now on.
    pub(super) fn retention(self) -> Result<Retention, Problem> {
        let Once(retention) = self.retention;
        Ok(ModelSettings::default().overridden(&json!({"retention": retention}))?.retention)
    }
}

fn body(model: &Model) -> Value {
    json!({
        "model": model.name,
        "method": model.method,
        "live": model.live,
        "head": model.head,
        "paused": model.paused,
        "settings": model.settings,
        "created_at": model.created_at.to_string(),
    })
}

fn answer(status: StatusCode, model: &Model) -> Answer {
    Answer::json(status, &body(model)).with_header(&ETAG, etag(model))
}

/// 201, and where it is.
pub(super) fn created(model: &Model) -> Answer {
    answer(StatusCode::CREATED, model).with_header(&LOCATION, format!("/v1/models/{}", model.name))
}

/// `POST /v1/models`
pub(super) async fn create(
    State(app): State<Arc<AppState>>,
    by: Actor,
    request: Repeatable,
    JsonBody { value: new, request_sha256 }: JsonBody<NewModel>,
) -> Result<Answer, Problem> {
    if let Some(answer) = request.recall(request_sha256).await? {
        return Ok(answer);
    }
    let (mut tx, model) = if let Some(Object(origin)) = &new.from {
        forked(&app, &by, &new, origin).await?
    } else {
        let settings = new.settings(&app.model_defaults)?;
        let mut tx = app.store.begin_for(&by).await?;
        let made = model::create(&mut tx, &new.model, new.method, &settings).await?;
        (tx, made.ok_or_else(|| fork::taken(&new.model))?)
    };
    let answer = created(&model);
    request.keep(&mut tx, request_sha256, &answer).await?;
    tx.commit().await?;
    tracing::info!(model = %model.name, method = model.method.as_str(), "model created");
    if model.live.is_some() {
        app.predictor.refresh(model.model_id).await;
    }
    Ok(answer)
}

/// The transaction of a fork, and what it makes.
async fn forked(
    app: &Arc<AppState>,
    by: &Actor,
    new: &NewModel,
    origin: &Origin,
) -> Result<(WriteTransaction, Model), Problem> {
    let _slot = app.copy_slots.try_acquire().map_err(|_| Problem::busy(Code::Busy, fork::BUSY))?;
    let of = origin.find(app, new.method).await?;
    let settings = of.settings.for_fork(&new.settings.0)?;
    settings.check_for(new.method)?;
    let mut tx = app.store.begin_for(by).await?;
    let fork = Fork { name: &new.model, of: &of, version: origin.version.0, settings: &settings };
    let model = fork::make(&mut tx, &fork).await?;
    Ok((tx, model))
}

/// `GET /v1/models`
pub(super) async fn list(State(app): State<Arc<AppState>>, caller: Caller, page: Page) -> Result<Answer, Problem> {
    let models = app.store.models_among(caller.models(), page.after, page.fetch()).await?;
    Ok(Answer::ok(&page.body("models", models, |model| model.model_id, body)))
}

/// `GET /v1/models/{model}`
pub(super) async fn read(ModelAt(model): ModelAt) -> Answer {
    answer(StatusCode::OK, &model)
}

/// `PATCH /v1/models/{model}`
pub(super) async fn change(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
    headers: HeaderMap,
    Json(change): Json<Change>,
) -> Result<Answer, Problem> {
    let retention = change.retention()?;
    let mut tx = app.store.begin_for(&by).await?;
    check_if_match(&headers, &model::get(&mut tx, model.model_id).await?)?;
    let model = model::set_retention(&mut tx, model.model_id, retention).await?;
    tx.commit().await?;
    tracing::info!(model = %model.name, ?retention, "retention changed");
    Ok(answer(StatusCode::OK, &model))
}

/// `POST /v1/models/{model}/pause`
pub(super) async fn pause(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
) -> Result<Answer, Problem> {
    set_paused(&app, &model, &by, true).await
}

/// `POST /v1/models/{model}/resume`
pub(super) async fn resume(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
) -> Result<Answer, Problem> {
    set_paused(&app, &model, &by, false).await
}

async fn set_paused(app: &AppState, model: &Model, by: &Actor, paused: bool) -> Result<Answer, Problem> {
    let mut tx = app.store.begin_for(by).await?;
    let model = model::set_paused(&mut tx, model.model_id, paused).await?;
    tx.commit().await?;
    if paused {
        app.scheduler.hold(model.model_id);
    } else {
        app.scheduler.wake();
    }
    Ok(answer(StatusCode::OK, &model))
}
