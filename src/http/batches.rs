//! `/v1/models/{model}/batches`: upload events, see what became of them, take them back.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_ENCODING, CONTENT_TYPE, HeaderMap, HeaderName, LOCATION};
use jiff::Timestamp;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use super::AppState;
use super::answer::Answer;
use super::body::{refuse_declared_excess, timed, too_large};
use super::context::RequestContext;
use super::idempotency::Repeatable;
use super::path::{BatchAt, ModelAt, batch_id, task_id};
use super::problem::{Code, InputError, Problem};
use super::query::{Page, Query};
use crate::formats::{Encoding, Format, FormatError};
use crate::ingest::{
    IngestError, Interrupted, OptionError, Receipt, Received, SpoolError, Spooled, Upload, UploadOptions,
};
use crate::ingest::{receive, spool};
use crate::lineage::{Batch, EventCounts, Model};
use crate::store::retract::{self, Retracted};
use crate::store::selection;

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
    })
}

fn counted_body(model: &Model, batch: &Batch, counts: EventCounts) -> Value {
    let mut body = body(model, batch);
    body["events"] = json!(counts);
    body
}

async fn find(app: &AppState, model: &Model, batch: i64) -> Result<Batch, Problem> {
    let missing = || Code::BatchNotFound.because(format!("{} has no batch {}", model.name, batch_id(batch)));
    app.store.batch(model.model_id, batch).await?.ok_or_else(missing)
}

/// `POST /v1/models/{model}/batches`
pub(super) async fn upload(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    context: RequestContext,
    request: Repeatable,
    Query(options): Query<UploadOptions>,
    http: Request,
) -> Result<Answer, Problem> {
    let (format, encoding) = kind(http.headers())?;
    options.conversion().map_err(|e| option_problem(&e))?;
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
        receive(&app.store, upload, &app.ingest).await.map_err(ingest_problem)?;
    let tasks = selection::create_due(&mut transaction, model_id, model.settings.schedule, received_at).await?;
    let answer = answer(&model, &context, &receipt, &tasks);
    request.keep(&mut transaction, request_sha256, &answer).await?;
    transaction.commit().await.map_err(Problem::internal)?;
    app.scheduler.wake();
    note(&app, &model, &receipt, bytes);
    Ok(answer)
}

fn kind(headers: &HeaderMap) -> Result<(Format, Encoding), Problem> {
    let text = |name: HeaderName| match headers.get(&name).map(|value| value.to_str()) {
        None => Ok(None),
        Some(Ok(text)) => Ok(Some(text)),
        Some(Err(_)) => Err(Code::MalformedHeader.because(format!("{name} is not ASCII"))),
    };
    let format = Format::from_content_type(text(CONTENT_TYPE)?.unwrap_or_default()).map_err(format_problem)?;
    let encoding = Encoding::from_content_encoding(text(CONTENT_ENCODING)?).map_err(format_problem)?;
    Ok((format, encoding))
}

/// What a request says beside its body, for the comparison with an earlier one of the same key.
fn said_besides(http: &Request) -> String {
    let header = |name: HeaderName| http.headers().get(name).and_then(|v| v.to_str().ok()).unwrap_or_default();
    let query = http.uri().query().unwrap_or_default();
    format!("{query}\n{}\n{}", header(CONTENT_TYPE), header(CONTENT_ENCODING))
}

fn digest(said: &str, body_sha256: &[u8; 32]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    hasher.update(said.as_bytes());
    hasher.update([0]);
    hasher.update(body_sha256);
    hasher.finalize().into()
}

async fn take_body(app: &AppState, http: Request<Body>) -> Result<Spooled, Problem> {
    let limit = app.ingest.max_body_bytes;
    refuse_declared_excess(http.headers(), limit)?;
    spool(timed(http.into_body(), app.settings.body_idle_s), &app.ingest).await.map_err(|interrupted| match interrupted
    {
        Interrupted::Body(problem) => problem,
        Interrupted::Spool(SpoolError::TooLarge { max_bytes }) => too_large(max_bytes),
        Interrupted::Spool(error @ SpoolError::Io(_)) => Problem::internal(error),
    })
}

fn answer(model: &Model, context: &RequestContext, receipt: &Receipt, tasks: &[i64]) -> Answer {
    let mut members: Map<String, Value> = match serde_json::to_value(receipt) {
        Ok(Value::Object(members)) => members,
        other => unreachable!("a receipt is an object: {other:?}"),
    };
    members.insert("task_ids".to_owned(), tasks.iter().map(|&task| task_id(task)).collect());
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

fn option_problem(error: &OptionError) -> Problem {
    Code::InvalidQuery.because(error.to_string()).with_error(InputError::parameter(
        error.name,
        error.code,
        error.detail.clone(),
    ))
}

fn ingest_problem(error: IngestError) -> Problem {
    match error {
        IngestError::Option(error) => option_problem(&error),
        IngestError::Format(error) => format_problem(error),
        IngestError::Store(error) => error.into(),
        IngestError::Panicked => Problem::internal(error),
    }
}

fn format_problem(error: FormatError) -> Problem {
    let code = match &error {
        FormatError::Truncated { .. } => Code::TruncatedBody,
        FormatError::Malformed { .. } => Code::MalformedBody,
        FormatError::Invalid { .. } => Code::InvalidBody,
        FormatError::TooLarge { .. } => Code::BodyTooLarge,
        FormatError::Unsupported { code: "not_available", .. } => Code::NotAvailable,
        FormatError::Unsupported { .. } => Code::UnsupportedMediaType,
        FormatError::Io(_) | FormatError::Stopped => return Problem::internal(error),
    };
    let problem = code.because(error.to_string());
    match error.place() {
        Some(place) => problem.with_error(InputError::within(place, error.code(), error.to_string())),
        None => problem,
    }
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
    Query(query): Query<Retraction>,
) -> Result<Answer, Problem> {
    if query.erase == Some(true) {
        return Err(Code::NotAvailable.because("erasing stored events comes with a later release"));
    }
    let mut tx = app.store.begin().await?;
    match retract::retract(&mut tx, model.model_id, batch, Timestamp::now()).await? {
        Retracted::Done { .. } | Retracted::Before => {}
        Retracted::Unknown => {
            return Err(Code::BatchNotFound.because(format!("{} has no batch {}", model.name, batch_id(batch))));
        }
        Retracted::Learned => {
            return Err(Code::BatchLearned.because("a version learned it; unlearning comes with a later release"));
        }
        Retracted::Claimed => return Err(Code::BatchInUse.because("cancel the task, or let it end")),
    }
    tx.commit().await.map_err(Problem::internal)?;
    let batch = find(&app, &model, batch).await?;
    let counts = app.store.batch_event_counts(batch.batch_id).await?;
    Ok(Answer::ok(&counted_body(&model, &batch, counts)))
}
