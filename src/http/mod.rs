//! The REST interface. One file per resource: routes, bodies, handlers. Status codes live here and nowhere else.

/// `Accept`.
mod accept;
/// Answers that can be kept and sent again.
mod answer;
/// Models as files.
mod archive;
/// Versions as files.
mod artifact;
/// `/v1/audit`.
mod audit;
/// Copies of the database.
mod backup;
/// Uploads and what became of them.
mod batches;
/// JSON bodies.
mod body;
/// Connections.
pub mod connections;
/// Request ids, log line, metrics, rendering of problems.
mod context;
/// `/openapi.json`, `/openapi.yaml`, `/docs`.
mod contract;
/// Versions as drivers of the IDM.
mod distilled;
/// Files that are handed out.
mod download;
/// `ETag` and `If-Match`.
mod etag;
/// Versions and reference drivers on events that are not kept.
mod evaluate;
/// What batches hold.
mod events;
/// Bodies of events.
mod events_body;
/// Measures and predictions as tables.
mod figures;
/// Models that begin where others are.
mod fork;
/// Who is let in.
mod gate;
/// `/healthz`, `/readyz`, `/metrics`.
mod health;
/// `Idempotency-Key`.
mod idempotency;
/// Versions out of files.
mod import;
/// What answers a connection's requests.
mod interface;
/// `/v1/keys`.
mod keys;
/// `/v1/models` and what holds a model's training.
mod models;
/// Arrays of numbers.
mod numbers;
/// JSON objects, where no array will do.
mod object;
/// JSON in which nothing is said twice.
mod once;
/// Names and ids in paths.
mod path;
/// How long a connection is waited for.
mod patience;
/// Predictions and simulations.
mod predict;
/// What is answered instead, and the table of its kinds.
mod problem;
/// `/problems`.
mod problems;
/// A task's progress as a stream.
mod progress;
/// Query parameters and paging.
mod query;
/// What is logged of strangers.
mod refusals;
/// What is read of a request, by itself.
pub mod reading;
/// What a replay came to.
mod replay;
/// A route and what it needs.
mod route;
/// Promote, rollback, history.
mod serving;
mod settings;
/// What browsers are told.
mod shield;
/// Where events come from, and releasing what is held.
mod sources;
/// Tasks counted as they end.
pub mod tally;
/// Answers as tables.
mod table;
/// Learning on request.
mod tasks;
/// Encrypted connections.
mod tls;
/// Requests that are answered whoever still listens.
mod to_the_end;
/// The Open Inference Protocol.
mod v2;
/// What tasks made.
mod versions;
/// Integers in bodies.
mod whole;

use std::any::Any;
use std::sync::Arc;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{Method, Uri};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::response::IntoResponse;
use tokio::sync::{Semaphore, watch};
use tower_http::catch_panic::CatchPanicLayer;

pub use context::RequestIds;
pub use evaluate::Evaluator;
pub use gate::{Gate, Need};
pub use idempotency::InFlight;
pub use interface::Interface;
pub use keys::body as key_body;
pub use problem::Code;
pub use refusals::Refusals;
pub use settings::ServerSettings;
pub use tls::{Tls, TlsSettings};
pub use v2::Unloaded;

use crate::access::Scope;
use crate::ingest::IngestSettings;
use crate::lineage::ModelSettings;
use crate::predictor::{Predictor, Sequences};
use crate::scheduler::Scheduler;
use crate::store::Store;
use crate::store::backup::BackupSettings;
use crate::telemetry::{Metrics, Statistics};
use problem::Problem;
use route::{Route, at};
use to_the_end::to_the_end;

/// What every handler may use.
#[derive(Debug)]
pub struct AppState {
    /// The database.
    pub store: Arc<Store>,
    /// Who is let in.
    pub gate: Gate,
    /// What runs, and how far it is.
    pub scheduler: Scheduler,
    /// Loaded versions.
    pub predictor: Arc<Predictor>,
    /// Vehicles that are answered step by step.
    pub sequences: Arc<Sequences>,
    /// Models that the inference protocol does not answer for.
    pub unloaded: Unloaded,
    /// What the inference protocol tells of versions.
    pub statistics: Statistics,
    /// What an upload may be.
    pub ingest: IngestSettings,
    /// Where copies of the database go.
    pub backup: BackupSettings,
    /// Copies at once.
    pub backup_slot: Arc<Semaphore>,
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
    /// Bytes of JSON bodies at once.
    pub body_room: Arc<Semaphore>,
    /// Uploads at once.
    pub upload_slots: Arc<Semaphore>,
    /// Predictions and simulations at once.
    pub prediction_slots: Arc<Semaphore>,
    /// What computes evaluations on events that are not kept.
    pub evaluator: Arc<Evaluator>,
    /// Evaluations at once.
    pub evaluation_slots: Arc<Semaphore>,
    /// Files handed out and taken in at once: versions, and events of batches.
    pub artifact_slots: Arc<Semaphore>,
    /// Models copied at once.
    pub copy_slots: Arc<Semaphore>,
    /// Open progress streams.
    pub stream_slots: Arc<Semaphore>,
    /// Which requests that the gate refuses are logged.
    pub refusals: Refusals,
    /// Names requests that did not bring an id.
    pub request_ids: RequestIds,
}

/// Every route, on one page, and what each needs of who calls it: whoever has a key may read what concerns its models.
/// `api/openapi.yaml` has the same list; a test holds them together.
fn routes() -> Vec<Route> {
    use Need::{AnyKey, EveryModel, May, Nothing};
    use Scope::{Admin, Ingest, Predict, Train};
    vec![
        at("/healthz").get(Nothing, health::live),
        at("/readyz").get(Nothing, health::ready),
        at("/metrics").get(EveryModel, health::metrics),
        at("/openapi.json").get(Nothing, contract::json),
        at("/openapi.yaml").get(Nothing, contract::yaml),
        at("/docs").get(Nothing, contract::viewer),
        at("/docs/{file}").get(Nothing, contract::viewer_file),
        at("/problems").get(Nothing, problems::list),
        at("/problems/{code}").get(Nothing, problems::read),
        at("/v1/backup").get(May(Admin), backup::list).post(May(Admin), backup::create),
        at("/v1/keys").get(May(Admin), keys::list).post(May(Admin), keys::create),
        at("/v1/keys/{key_id}").get(May(Admin), keys::read).delete(May(Admin), keys::revoke),
        at("/v1/audit").get(May(Admin), audit::list),
        at("/v1/models").get(AnyKey, models::list).post(May(Train), models::create),
        at("/v1/models/{model}").get(AnyKey, models::read).patch(May(Admin), models::change),
        at("/v1/models/{model}/archive").get(May(Admin), archive::download).post(May(Admin), archive::take_in),
        at("/v1/models/{model}/pause").post(May(Train), models::pause),
        at("/v1/models/{model}/resume").post(May(Train), models::resume),
        at("/v1/models/{model}/batches").get(AnyKey, batches::list).post(May(Ingest), batches::upload),
        at("/v1/models/{model}/batches/{batch_id}").get(AnyKey, batches::read).delete(May(Train), batches::retract),
        at("/v1/models/{model}/batches/{batch_id}/rejections").get(AnyKey, batches::rejections),
        at("/v1/models/{model}/batches/{batch_id}/events").get(AnyKey, events::download),
        at("/v1/models/{model}/sources").get(AnyKey, sources::list),
        at("/v1/models/{model}/sources/{source}/release").post(May(Train), sources::release),
        at("/v1/models/{model}/tasks").get(AnyKey, tasks::list).post(May(Train), tasks::create),
        at("/v1/models/{model}/tasks/{task_id}").get(AnyKey, tasks::read),
        at("/v1/models/{model}/tasks/{task_id}/cancel").post(May(Train), tasks::cancel),
        at("/v1/models/{model}/tasks/{task_id}/progress").get(AnyKey, progress::watch),
        at("/v1/models/{model}/versions").get(AnyKey, versions::list).post(May(Train), import::create),
        at("/v1/models/{model}/versions/{version}").get(AnyKey, versions::read).patch(May(Train), versions::annotate),
        at("/v1/models/{model}/versions/{version}/evaluation").get(AnyKey, versions::evaluation),
        at("/v1/models/{model}/versions/{version}/artifact").get(AnyKey, artifact::download),
        at("/v1/models/{model}/evaluate").post(May(Predict), evaluate::evaluate),
        at("/v1/models/{model}/promote").post(May(Train), serving::promote),
        at("/v1/models/{model}/rollback").post(May(Train), serving::rollback),
        at("/v1/models/{model}/history").get(AnyKey, serving::history),
        at(predict::ROUTE).post(predict::NEED, predict::predict),
        at("/v1/models/{model}/simulate").post(May(Predict), predict::simulate),
        at("/v2").get(Nothing, v2::server),
        at("/v2/health/live").get(Nothing, v2::live),
        at("/v2/health/ready").get(Nothing, v2::ready),
        at("/v2/models/stats").get(EveryModel, v2::all_statistics),
        at("/v2/models/{model}").get(AnyKey, v2::model),
        at("/v2/models/{model}/versions/{version}").get(AnyKey, v2::model),
        at("/v2/models/{model}/ready").get(AnyKey, v2::model_ready),
        at("/v2/models/{model}/versions/{version}/ready").get(AnyKey, v2::model_ready),
        at("/v2/models/{model}/config").get(AnyKey, v2::config),
        at("/v2/models/{model}/versions/{version}/config").get(AnyKey, v2::config),
        at("/v2/models/{model}/stats").get(AnyKey, v2::statistics),
        at("/v2/models/{model}/versions/{version}/stats").get(AnyKey, v2::statistics),
        at("/v2/models/{model}/infer").post(May(Predict), v2::infer),
        at("/v2/models/{model}/versions/{version}/infer").post(May(Predict), v2::infer),
        at("/v2/repository/index").post(AnyKey, v2::index),
        at("/v2/repository/models/{model}/load").post(May(Train), v2::load),
        at("/v2/repository/models/{model}/unload").post(May(Train), v2::unload),
    ]
}

/// Waits until the server is told to stop.
async fn stopped(stopping: &mut watch::Receiver<bool>) {
    // A sender that is gone stops the server too.
    let _ = stopping.wait_for(|&stop| stop).await;
}

/// Path, method and need of every route, as `api/openapi.yaml` writes them.
#[must_use]
pub fn needs() -> Vec<(&'static str, Method, Need)> {
    let told =
        |route: &Route| route.needs().map(|(path, method, need)| (path, method.clone(), need)).collect::<Vec<_>>();
    routes().iter().flat_map(told).collect()
}

/// Every route and what is around all of them.
fn router(app: Arc<AppState>) -> Router {
    let (router, needs) = route::router(routes());
    let around = context::Around { app: Arc::clone(&app), needs: Arc::new(needs) };
    let router = router
        .fallback(async |uri: Uri| Code::NotFound.because(format!("{} is not a path of this server", uri.path())))
        .method_not_allowed_fallback(async |method: Method| Code::MethodNotAllowed.because(format!("{method} is none")))
        .layer(from_fn(to_the_end))
        .layer(CatchPanicLayer::custom(|payload: Box<dyn Any + Send>| panicked(&*payload).into_response()))
        .layer(from_fn_with_state(around, context::observe))
        // Bodies are bounded where they are read: JSON and uploads have limits of their own.
        .layer(DefaultBodyLimit::disable());
    let router = match shield::cors(&app.settings.cors_origins) {
        Some(cors) => router.layer(cors),
        None => router,
    };
    router.with_state(app)
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
