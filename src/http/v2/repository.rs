//! `/v2/repository`: which models there are, and for which the protocol answers.

use std::collections::BTreeSet;
use std::sync::{Arc, PoisonError, RwLock};

use axum::extract::{Request, State};
use axum::http::StatusCode;
use serde::Deserialize;
use serde_json::{Value, json};

use super::super::AppState;
use super::super::answer::Answer;
use super::super::body::{parse, read_whole};
use super::super::gate::Caller;
use super::super::path::ServedAt;
use super::super::predict;
use super::super::problem::{Code, Problem};
use crate::lineage::Model;

/// Models that a client has unloaded. That concerns the protocol alone, until they are loaded again or the server starts anew:
/// what serves, the native interface decides.
#[derive(Debug, Default)]
pub struct Unloaded(RwLock<BTreeSet<i64>>);

impl Unloaded {
    /// Refuses a model that is unloaded.
    ///
    /// # Errors
    /// When it is.
    pub(super) fn check(&self, model: &ServedAt) -> Result<(), Problem> {
        if self.has(model.model_id) {
            return Err(Code::NotReady.because(format!("{} is unloaded; load it first", model.name)));
        }
        Ok(())
    }

    fn has(&self, model_id: i64) -> bool {
        self.0.read().unwrap_or_else(PoisonError::into_inner).contains(&model_id)
    }

    fn change(&self, change: impl FnOnce(&mut BTreeSet<i64>)) {
        change(&mut self.0.write().unwrap_or_else(PoisonError::into_inner));
    }
}

/// The body of an index; none is the same as an empty one.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wish {
    #[serde(default)]
    ready: bool,
}

/// Small bodies that clients may leave out.
async fn wish<T: serde::de::DeserializeOwned + Default>(app: &AppState, request: Request) -> Result<T, Problem> {
    let (parts, body) = request.into_parts();
    let held = read_whole(&parts.headers, body, app).await?;
    if held.bytes.is_empty() { Ok(T::default()) } else { parse(&held.bytes) }
}

/// `POST /v2/repository/index`
pub(in crate::http) async fn index(
    State(app): State<Arc<AppState>>,
    caller: Caller,
    request: Request,
) -> Result<Answer, Problem> {
    let Wish { ready } = wish(&app, request).await?;
    let models = app.store.models_among(caller.models(), 0, app.settings.page_size_max).await?;
    let entries = models.iter().map(|model| entry(&app, model));
    let listed: Vec<_> = entries.filter(|entry| !ready || entry["state"] == "READY").collect();
    Ok(Answer::json(StatusCode::OK, &listed))
}

fn entry(app: &AppState, model: &Model) -> Value {
    let answering = app.predictor.answering(model.model_id);
    let reason = match answering {
        _ if app.unloaded.has(model.model_id) => "unloaded",
        None if model.live.is_none() => "nothing is live",
        None => "the live version cannot be loaded",
        Some(_) => "",
    };
    let version = answering.map(|version| version.to_string()).unwrap_or_default();
    let state = if reason.is_empty() { "READY" } else { "UNAVAILABLE" };
    json!({"name": model.name, "version": version, "state": state, "reason": reason})
}

/// `POST /v2/repository/models/{model}/load`
pub(in crate::http) async fn load(
    State(app): State<Arc<AppState>>,
    model: ServedAt,
    request: Request,
) -> Result<Answer, Problem> {
    wish::<Value>(&app, request).await?;
    predict::load(&app, &model, None).await?;
    app.unloaded.change(|unloaded| {
        unloaded.remove(&model.model_id);
    });
    tracing::info!(model = model.name, "loaded for the inference protocol");
    Ok(Answer::ok(&json!({})))
}

/// `POST /v2/repository/models/{model}/unload`
pub(in crate::http) async fn unload(
    State(app): State<Arc<AppState>>,
    model: ServedAt,
    request: Request,
) -> Result<Answer, Problem> {
    wish::<Value>(&app, request).await?;
    app.unloaded.change(|unloaded| {
        unloaded.insert(model.model_id);
    });
    tracing::info!(model = model.name, "unloaded for the inference protocol");
    Ok(Answer::ok(&json!({})))
}
