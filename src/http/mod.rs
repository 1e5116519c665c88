//! The REST interface. One file per resource: routes, bodies, handlers. Status codes live here and nowhere else.

/// Calls the interface names and this release does not answer yet.
mod absent;
/// Answers that can be kept and sent again.
mod answer;
/// Uploads and what became of them.
mod batches;
/// JSON bodies.
mod body;
/// Connections.
pub mod connections;
/// Request ids, log line, metrics, rendering of problems.
mod context;
/// `ETag` and `If-Match`.
mod etag;
/// Versions and reference drivers on events that are not kept.
mod evaluate;
/// Bodies of events.
mod events_body;
/// `/healthz`, `/readyz`, `/metrics`.
mod health;
/// `Idempotency-Key`.
mod idempotency;
/// What answers a connection's requests.
mod interface;
/// `/v1/models` and what holds a model's training.
mod models;
/// Arrays of numbers.
mod numbers;
/// JSON objects, where no array will do.
mod object;
/// Names and ids in paths.
mod path;
/// Predictions and simulations.
mod predict;
/// The table of problems.
mod problem;
/// A task's progress as a stream.
mod progress;
/// Query parameters and paging.
mod query;
/// Promote, rollback, history.
mod serving;
mod settings;
/// Tasks counted as they end.
pub mod tally;
/// Learning on request.
mod tasks;
/// What tasks made.
mod versions;

use std::any::Any;
use std::sync::Arc;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{Method, Uri};
use axum::middleware::from_fn_with_state;
use axum::response::IntoResponse;
use axum::routing::{MethodRouter, get, post};
use tokio::sync::{Semaphore, watch};
use tower_http::catch_panic::CatchPanicLayer;

pub use context::RequestIds;
pub use evaluate::Evaluator;
pub use idempotency::InFlight;
pub use interface::Interface;
pub use problem::Code;
pub use settings::ServerSettings;

use crate::ingest::IngestSettings;
use crate::lineage::ModelSettings;
use crate::predictor::Predictor;
use crate::scheduler::Scheduler;
use crate::store::Store;
use crate::telemetry::Metrics;
use problem::Problem;

/// What every handler may use.
#[derive(Debug)]
pub struct AppState {
    /// The database.
    pub store: Arc<Store>,
    /// What runs, and how far it is.
    pub scheduler: Scheduler,
    /// Loaded versions.
    pub predictor: Arc<Predictor>,
    /// What an upload may be.
    pub ingest: IngestSettings,
    /// Limits and patience.
    pub settings: ServerSettings,
    /// Settings of models that are created without their own.
    pub model_defaults: ModelSettings,
    /// This server's metrics.
    pub metrics: Metrics,
    /// Turns true when the server is told to stop.
    pub stopping: watch::Receiver<bool>,
    /// Requests with an `Idempotency-Key` under way.
    pub in_flight: InFlight,
    /// Uploads at once.
    pub upload_slots: Arc<Semaphore>,
    /// Predictions and simulations at once.
    pub prediction_slots: Arc<Semaphore>,
    /// What computes evaluations on events that are not kept.
    pub evaluator: Arc<Evaluator>,
    /// Evaluations at once.
    pub evaluation_slots: Arc<Semaphore>,
    /// Open progress streams.
    pub stream_slots: Arc<Semaphore>,
    /// Names requests that did not bring an id.
    pub request_ids: RequestIds,
}

type Route = (&'static str, MethodRouter<Arc<AppState>>);

/// Every route, on one page. `api/openapi.yaml` has the same list; a test holds them together.
fn routes() -> Vec<Route> {
    vec![
        ("/healthz", get(health::live)),
        ("/readyz", get(health::ready)),
        ("/metrics", get(health::metrics)),
        ("/v1/models", get(models::list).post(models::create)),
        ("/v1/models/{model}", get(models::read)),
        ("/v1/models/{model}/pause", post(models::pause)),
        ("/v1/models/{model}/resume", post(models::resume)),
        ("/v1/models/{model}/batches", get(batches::list).post(batches::upload)),
        ("/v1/models/{model}/batches/{batch_id}", get(batches::read).delete(batches::retract)),
        ("/v1/models/{model}/batches/{batch_id}/rejections", get(batches::rejections)),
        ("/v1/models/{model}/tasks", get(tasks::list).post(tasks::create)),
        ("/v1/models/{model}/tasks/{task_id}", get(tasks::read)),
        ("/v1/models/{model}/tasks/{task_id}/cancel", post(tasks::cancel)),
        ("/v1/models/{model}/tasks/{task_id}/progress", get(progress::watch)),
        ("/v1/models/{model}/versions", get(versions::list).post(absent::import)),
        ("/v1/models/{model}/versions/{version}", get(versions::read).patch(versions::annotate)),
        ("/v1/models/{model}/versions/{version}/evaluation", get(versions::evaluation)),
        ("/v1/models/{model}/versions/{version}/artifact", get(absent::artifact)),
        ("/v1/models/{model}/evaluate", post(evaluate::evaluate)),
        ("/v1/models/{model}/promote", post(serving::promote)),
        ("/v1/models/{model}/rollback", post(serving::rollback)),
        ("/v1/models/{model}/history", get(serving::history)),
        (predict::ROUTE, post(predict::predict)),
        ("/v1/models/{model}/simulate", post(predict::simulate)),
    ]
}

/// Waits until the server is told to stop.
async fn stopped(stopping: &mut watch::Receiver<bool>) {
    // A sender that is gone stops the server too.
    let _ = stopping.wait_for(|&stop| stop).await;
}

/// The paths of all routes, as `api/openapi.yaml` writes them.
#[must_use]
pub fn paths() -> Vec<&'static str> {
    routes().into_iter().map(|(path, _)| path).collect()
}

/// Every route and what is around all of them.
fn router(app: Arc<AppState>) -> Router {
    let router = routes().into_iter().fold(Router::new(), |router, (path, methods)| router.route(path, methods));
    router
        .fallback(async |uri: Uri| Code::NotFound.because(format!("{} is not a path of this server", uri.path())))
        .method_not_allowed_fallback(async |method: Method| Code::MethodNotAllowed.because(format!("{method} is none")))
        .layer(CatchPanicLayer::custom(|payload: Box<dyn Any + Send>| panicked(&*payload).into_response()))
        .layer(from_fn_with_state(Arc::clone(&app), context::observe))
        // Bodies are bounded where they are read: JSON and uploads have limits of their own.
        .layer(DefaultBodyLimit::disable())
        .with_state(app)
}

/// A 500 for a handler that panicked.
fn panicked(payload: &(dyn Any + Send)) -> Problem {
    let cause = payload
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| payload.downcast_ref::<&str>().copied())
        .unwrap_or("no message");
    Problem::internal(format!("panic: {cause}"))
}
