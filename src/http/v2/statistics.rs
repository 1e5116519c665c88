//! `…/stats`: what was asked of each version under `/v2`, and how long it took, since the server started.

use std::sync::Arc;

use axum::extract::State;
use serde_json::{Value, json};

use super::super::AppState;
use super::super::answer::Answer;
use super::super::path::{MaybeVersionAt, ModelAt};
use super::super::problem::Problem;
use super::super::versions;
use crate::telemetry::{Timed, VersionStatistics};

fn body(model: &str, version: i64, known: &VersionStatistics) -> Value {
    json!({
        "name": model,
        "version": version.to_string(),
        "last_inference": known.last_inference_ms,
        "inference_count": known.inferences,
        "execution_count": known.success.count,
        "inference_stats": {
            "success": known.success,
            "fail": known.fail,
            // Waiting for others is part of compute_infer: it is not measured by itself.
            "queue": Timed::default(),
            "compute_input": known.input,
            "compute_infer": known.infer,
            "compute_output": known.output,
            // Nothing is cached.
            "cache_hit": Timed::default(),
            "cache_miss": Timed::default(),
        },
        "batch_stats": [],
    })
}

/// `GET /v2/models/{model}[/versions/{version}]/stats`
pub(in crate::http) async fn of(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    MaybeVersionAt(version): MaybeVersionAt,
) -> Result<Answer, Problem> {
    let mut known = app.statistics.of(model.name.as_str());
    if let Some(version) = version {
        versions::find(&app, &model, version).await?;
        known.retain(|&(of, _)| of == version);
        if known.is_empty() {
            known.push((version, VersionStatistics::default()));
        }
    }
    let stats: Vec<_> = known.iter().map(|(version, known)| body(model.name.as_str(), *version, known)).collect();
    Ok(Answer::ok(&json!({"model_stats": stats})))
}

/// `GET /v2/models/stats`
pub(in crate::http) async fn all(State(app): State<Arc<AppState>>) -> Answer {
    let of = |model: String| {
        let known = app.statistics.of(&model);
        known.into_iter().map(move |(version, known)| body(&model, version, &known)).collect::<Vec<_>>()
    };
    let stats: Vec<_> = app.statistics.models().into_iter().flat_map(of).collect();
    Answer::ok(&json!({"model_stats": stats}))
}
