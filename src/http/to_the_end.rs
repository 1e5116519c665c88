//! Requests that are answered to their end, whoever still listens.
//!
//! When a client goes away its request is dropped wherever it waits: between the commit of a promotion and the word to the
//! predictor, too, and then the version before would go on serving. So what may change something runs as a task of its own.

use std::panic::resume_unwind;

use axum::extract::Request;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tracing::Instrument;

use super::problem::{Code, Problem};

/// The layer.
pub(super) async fn to_the_end(request: Request, next: Next) -> Response {
    if request.method().is_safe() {
        return next.run(request).await;
    }
    let answering = tokio::spawn(next.run(request).in_current_span());
    answering.await.unwrap_or_else(|lost| match lost.try_into_panic() {
        Ok(payload) => resume_unwind(payload),
        Err(_) => Problem::busy(Code::ShuttingDown, "no new work is taken").into_response(),
    })
}
