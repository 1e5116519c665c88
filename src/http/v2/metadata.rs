//! `/v2/models/{model}`, with or without a version: what it takes and gives.

use std::sync::Arc;

use axum::extract::State;
use serde_json::json;

use super::super::AppState;
use super::super::answer::Answer;
use super::super::path::{MaybeVersionAt, ModelAt, ServedAt};
use super::super::predict;
use super::super::problem::Problem;
use super::super::versions;
use crate::lineage::Model;

/// What is given, in the order in which it is answered when all is asked for.
pub(super) const OUTPUTS: [&str; 2] = ["accel_mps2", "raw_accel_mps2"];

/// What computes, as the protocol names it.
const PLATFORM: &str = "headway_lstm";

/// Steps of a window of the named version, else of the model's.
async fn horizon(app: &AppState, model: &Model, version: Option<i64>) -> Result<u32, Problem> {
    Ok(match version {
        Some(version) => versions::find(app, model, version).await?.settings.horizon,
        None => model.settings.horizon,
    })
}

/// `GET /v2/models/{model}[/versions/{version}]`
pub(in crate::http) async fn model(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    MaybeVersionAt(version): MaybeVersionAt,
) -> Result<Answer, Problem> {
    let horizon = horizon(&app, &model, version).await?;
    let numbers = match version {
        Some(version) => vec![version],
        None => app.store.newest_versions(model.model_id, app.settings.page_size_max).await?,
    };
    let tensor = |name: &str, shape: &[i64]| json!({"name": name, "datatype": "FP32", "shape": shape});
    Ok(Answer::ok(&json!({
        "name": model.name,
        "versions": numbers.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "platform": PLATFORM,
        "inputs": [tensor("window", &[-1, i64::from(horizon), 4]), tensor("step", &[1, 4])],
        "outputs": OUTPUTS.map(|name| tensor(name, &[-1, 1])),
    })))
}

/// `GET …/config`
pub(in crate::http) async fn config(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    MaybeVersionAt(version): MaybeVersionAt,
) -> Result<Answer, Problem> {
    let horizon = horizon(&app, &model, version).await?;
    let idle_us = (app.predictor.settings().sequence_idle_s * 1e6) as u64;
    let input =
        |name: &str, dims: &[u32]| json!({"name": name, "data_type": "TYPE_FP32", "dims": dims, "optional": true});
    let output = |name: &str| json!({"name": name, "data_type": "TYPE_FP32", "dims": [1]});
    Ok(Answer::ok(&json!({
        "name": model.name,
        "platform": PLATFORM,
        "backend": "headway",
        "max_batch_size": app.settings.predict_windows_max,
        "version_policy": {"all": {}},
        "input": [input("window", &[horizon, 4]), input("step", &[4])],
        "output": OUTPUTS.map(output),
        "sequence_batching": {"max_sequence_idle_microseconds": idle_us},
    })))
}

/// `GET …/ready`: whether a request would be answered.
pub(in crate::http) async fn ready(
    State(app): State<Arc<AppState>>,
    model: ServedAt,
    MaybeVersionAt(version): MaybeVersionAt,
) -> Result<Answer, Problem> {
    app.unloaded.check(&model)?;
    let loaded = predict::load(&app, &model, version).await?;
    Ok(Answer::ok(&json!({"name": model.name, "version": loaded.version().to_string(), "ready": true})))
}
