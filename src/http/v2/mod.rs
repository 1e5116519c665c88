//! The Open Inference Protocol, version 2, with the extensions for binary tensors, sequences, statistics and the model repository:
//! `docs/inference_protocol.md` says what is there. What is asked and answered is what the native interface has; only the words
//! are others.

/// Predictions.
mod infer;
/// What a model takes and gives.
mod metadata;
/// What is answered.
mod outputs;
/// Which models there are, and which of them the protocol answers for.
mod repository;
/// What is asked.
mod request;
/// The server as a whole.
mod server;
/// Counts and times.
mod statistics;
/// Arrays of numbers, however they are sent.
mod tensor;

use std::fmt::Write;

use axum::http::StatusCode;
use serde_json::{Value, json};

pub(super) use infer::infer;
pub(super) use metadata::{config, model, ready as model_ready};
pub use repository::Unloaded;
pub(super) use repository::{index, load, unload};
pub(super) use request::{Input, Request, understood};
pub(super) use server::{live, ready, server};
pub(super) use statistics::{all as all_statistics, of as statistics};

use super::answer::Answer;
use super::problem::{Problem, RequestContext};

/// Whether a path, or a route's, belongs to the protocol.
pub(super) fn is_under(path: &str) -> bool {
    path.strip_prefix("/v2").is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// A problem as the protocol tells it: status and headers are the same, and the text says all that the native body does.
pub(super) fn refused(problem: &Problem, context: &RequestContext) -> Answer {
    let native = problem.answer(context).into_stored();
    let status = StatusCode::from_u16(native.status).expect("an answer's status");
    let told: Value = serde_json::from_slice(&native.body).expect("a problem is JSON");
    let text = |member: &Value| member.as_str().unwrap_or_default().to_owned();
    let mut error = format!("{}: {}", text(&told["title"]), text(&told["detail"]));
    for wrong in told["errors"].as_array().into_iter().flatten() {
        let place = ["pointer", "parameter"].iter().find_map(|place| wrong[*place].as_str()).unwrap_or_default();
        let detail = text(&wrong["detail"]);
        if !error.contains(&detail) {
            let _ = write!(error, "; {place}: {detail}");
        }
    }
    let body = json!({"error": format!("{error} ({}, request {})", text(&told["code"]), text(&told["request_id"]))});
    let own = Answer::json(status, &body);
    let others = native.headers.into_iter().filter(|(name, _)| name != "content-type");
    others.fold(own, |answer, (name, value)| answer.with_header(&name.parse().expect("a header's name"), value))
}
