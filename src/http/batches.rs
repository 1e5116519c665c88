//! `/v1/models/{model}/batches`: upload events, see what became of them, take them back.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_ENCODING, CONTENT_TYPE, HeaderName, LOCATION};
use jiff::Timestamp;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use super::AppState;
use super::answer::Answer;
use super::events_body::{ingest_problem, kind, option_problem, take_body};
use super::gate::Caller;
use super::idempotency::Repeatable;
use super::path::{BatchAt, ModelAt, batch_id, task_id};
use super::problem::{Code, Problem, RequestContext};
use super::query::{Page, Query};
use super::tasks;
use crate::access::Scope;
use crate::ingest::{Receipt, Received, Upload, UploadOptions, receive};
use crate::lineage::{Batch, EventCounts, Model};
use crate::store::erase;
use crate::store::retract::{self, Retracted};
use crate::store::{Actor, selection};

/// The query of a retraction.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Retraction {
    erase: Option<bool>,
}

fn body(model: &Model, batch: &Batch) -> Value {
    json!({
        "batch_id": batch_id(batch.batch_id),
        "model": model.name,
        "source": batch.source,
        "regime": batch.regime,
        "content_type": batch.content_type,
        "body_sha256": batch.body_sha256,
        "body_bytes": batch.body_bytes,
        "accepted": batch.accepted,
        "duplicates": batch.duplicates,
        "rejected_count": batch.rejected,
        "summary": batch.summary,
        "created_at": batch.created_at.to_string(),
        "retracted_at": batch.retracted_at.map(|at| at.to_string()),
        "erase_asked_at": batch.erase_asked_at.map(|at| at.to_string()),
        "erased_at": batch.erased_at.map(|at| at.to_string()),
    })
}

fn counted_body(model: &Model, batch: &Batch, counts: EventCounts) -> Value {
    let mut body = body(model, batch);
    body["events"] = json!(counts);
    body["pruned_events"] = json!(counts.pruned);
    body
}

/// The batch of this id.
pub(super) async fn find(app: &AppState, model: &Model, batch: i64) -> Result<Batch, Problem> {
    let missing = || Code::BatchNotFound.because(format!("{} has no batch {}", model.name, batch_id(batch)));
    app.store.batch(model.model_id, batch).await?.ok_or_else(missing)
}

/// `POST /v1/models/{model}/batches`
pub(super) async fn upload(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
    context: RequestContext,
    request: Repeatable,
    Query(options): Query<UploadOptions>,
    http: Request,
) -> Result<Answer, Problem> {
    let (format, encoding) = kind(http.headers())?;
    options.conversion(format).map_err(|e| option_problem(&e))?;
    options.extraction(format, &app.ingest.extraction).map_err(|e| option_problem(&e))?;
    let full = "as many uploads as the server takes at once are under way";
    let _slot = app.upload_slots.try_acquire().map_err(|_| Problem::busy(Code::Busy, full))?;
    let said = said_besides(&http);
    let body = take_body(&app, http).await?;
    let request_sha256 = digest(&said, &body.sha256);
    if let Some(answer) = request.recall(request_sha256).await? {
        return Ok(answer);
    }
    let bytes = body.bytes;
    let received_at = Timestamp::now();
    let (model_id, settings) = (model.model_id, model.settings.clone());
    let upload = Upload { model_id, model: settings, format, encoding, options, body, received_at };
    let Received { mut transaction, receipt } =
        receive(&app.store, &by, upload, &app.ingest).await.map_err(ingest_problem)?;
    let tasks = selection::create_due(&mut transaction, model_id, model.settings.schedule, received_at).await?;
    let answer = answer(&model, &context, &receipt, &tasks);
    request.keep_about(&mut transaction, request_sha256, &answer, Some(receipt.batch_id)).await?;
    transaction.commit().await?;
    app.scheduler.wake();
    note(&app, &model, &receipt, bytes);
    Ok(answer)
}

/// What a request says beside its body, for the comparison with an earlier one of the same key.
pub(super) fn said_besides(http: &Request) -> String {
    let header = |name: HeaderName| http.headers().get(name).and_then(|v| v.to_str().ok()).unwrap_or_default();
    let query = http.uri().query().unwrap_or_default();
    format!("{query}\n{}\n{}", header(CONTENT_TYPE), header(CONTENT_ENCODING))
}

/// Of all that makes a repeated request the same.
pub(super) fn digest(said: &str, body_sha256: &[u8; 32]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    hasher.update(said.as_bytes());
    hasher.update([0]);
    hasher.update(body_sha256);
    hasher.finalize().into()
}

/// What an upload is answered, and an import: its receipt, and the tasks that were due with it.
///
/// # Panics
/// Never: a receipt is an object.
#[must_use]
pub(super) fn receipt_body(receipt: &Receipt, tasks: &[i64]) -> Map<String, Value> {
    let mut members: Map<String, Value> = match serde_json::to_value(receipt) {
        Ok(Value::Object(members)) => members,
        other => unreachable!("a receipt is an object: {other:?}"),
    };
    members.insert("task_ids".to_owned(), tasks.iter().map(|&task| task_id(task)).collect());
    members
}

fn answer(model: &Model, context: &RequestContext, receipt: &Receipt, tasks: &[i64]) -> Answer {
    let members = receipt_body(receipt, tasks);
    let location = format!("/v1/models/{}/batches/{}", model.name, batch_id(receipt.batch_id));
    if receipt.holds_nothing() {
        let detail = match receipt.rejected_count {
            0 => "the body holds no event".to_owned(),
            count => format!("each of {count} events was refused; `rejected` says why"),
        };
        return Code::NoEventAccepted.because(detail).with_members(members).answer(context);
    }
    Answer::json(StatusCode::CREATED, &members).with_header(&LOCATION, location)
}

fn note(app: &AppState, model: &Model, receipt: &Receipt, bytes: u64) {
    let outcome = if receipt.holds_nothing() { "refused" } else { "stored" };
    let events =
        [("accepted", receipt.accepted), ("duplicate", receipt.duplicates), ("rejected", receipt.rejected_count)];
    app.metrics.upload(model.name.as_str(), outcome, bytes, events);
    let Receipt { batch_id, accepted, duplicates, rejected_count, .. } = receipt;
    tracing::info!(model = %model.name, batch_id, accepted, duplicates, rejected_count, bytes, "batch stored");
}

/// `GET /v1/models/{model}/batches`
pub(super) async fn list(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    page: Page,
) -> Result<Answer, Problem> {
    let batches = app.store.batches(model.model_id, page.after, page.fetch()).await?;
    Ok(Answer::ok(&page.body("batches", batches, |batch| batch.batch_id, |batch| body(&model, batch))))
}

/// `GET /v1/models/{model}/batches/{batch_id}`
pub(super) async fn read(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    BatchAt(batch): BatchAt,
) -> Result<Answer, Problem> {
    let batch = find(&app, &model, batch).await?;
    let counts = app.store.batch_event_counts(batch.batch_id).await?;
    Ok(Answer::ok(&counted_body(&model, &batch, counts)))
}

/// `GET /v1/models/{model}/batches/{batch_id}/rejections`
pub(super) async fn rejections(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    BatchAt(batch): BatchAt,
    page: Page,
) -> Result<Answer, Problem> {
    find(&app, &model, batch).await?;
    let rejections = app.store.rejections(batch, page.after, page.fetch()).await?;
    let numbered = (page.after + 1..).zip(rejections).collect();
    Ok(Answer::ok(&page.body("rejections", numbered, |(number, _)| *number, |(_, rejection)| json!(rejection))))
}

/// `DELETE /v1/models/{model}/batches/{batch_id}`
pub(super) async fn retract(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    BatchAt(batch): BatchAt,
    caller: Caller,
    by: Actor,
    Query(query): Query<Retraction>,
) -> Result<Answer, Problem> {
    if query.erase == Some(true) {
        caller.must(Scope::Admin)?;
    }
    let mut tx = app.store.begin_for(&by).await?;
    let (stopped, replaying) = match retract::retract(&mut tx, model.model_id, batch, Timestamp::now()).await? {
        Retracted::Done { stopped, .. } => (stopped, None),
        Retracted::Replaying { task_id, stopped } => (stopped, Some(task_id)),
        Retracted::Before { replaying } => (Vec::new(), replaying),
        Retracted::Pruned { version } => {
            let why = "would have to be learned again without the batch, and retention did not keep its events; roll back to a \
                       version before it, or learn anew";
            return Err(Code::EventsPruned.because(format!("version {version} {why}")));
        }
        Retracted::Unknown => {
            return Err(Code::BatchNotFound.because(format!("{} has no batch {}", model.name, batch_id(batch))));
        }
    };
    if query.erase == Some(true) {
        erase::ask(&mut tx, batch, Timestamp::now()).await?;
    }
    tx.commit().await?;
    for task in stopped {
        app.scheduler.cancel(task);
    }
    app.scheduler.wake();
    if let Some(replay) = replaying {
        let shown = tasks::body(&app, &model, &tasks::find(&app, &model, replay).await?);
        let location = format!("/v1/models/{}/tasks/{}", model.name, task_id(replay));
        return Ok(Answer::json(StatusCode::ACCEPTED, &shown).with_header(&LOCATION, location));
    }
    let batch = find(&app, &model, batch).await?;
    let counts = app.store.batch_event_counts(batch.batch_id).await?;
    Ok(Answer::ok(&counted_body(&model, &batch, counts)))
}
