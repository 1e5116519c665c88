//! `/v2` and its health checks.

use std::sync::Arc;

use axum::extract::State;
use axum::http::HeaderMap;
use serde_json::json;

use super::super::AppState;
use super::super::answer::Answer;
use super::super::health;
use super::super::problem::Problem;

/// `GET /v2`
pub(in crate::http) async fn server() -> Answer {
    Answer::ok(&json!({
        "name": "headway",
        "version": env!("CARGO_PKG_VERSION"),
        "extensions": ["binary_tensor_data", "sequence", "statistics", "model_repository", "model_configuration"],
    }))
}

/// `GET /v2/health/live`
pub(in crate::http) async fn live() -> Answer {
    Answer::ok(&json!({"live": true}))
}

/// `GET /v2/health/ready`
pub(in crate::http) async fn ready(app: State<Arc<AppState>>, headers: HeaderMap) -> Result<Answer, Problem> {
    health::ready(app, headers).await?;
    Ok(Answer::ok(&json!({"ready": true})))
}
