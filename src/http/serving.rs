//! Who serves: promote, rollback, and the history of both.

use std::sync::Arc;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::http::header::ETAG;
use jiff::Timestamp;
use serde::Deserialize;
use serde_json::{Value, json};

use super::AppState;
use super::answer::Answer;
use super::body::JsonBody;
use super::etag::{check_if_match, etag};
use super::idempotency::Repeatable;
use super::path::{ModelAt, task_id};
use super::problem::{Code, InputError, Problem};
use super::query::Page;
use super::replay::report_body;
use super::versions;
use super::whole::Whole;
use crate::lineage::Model;
use crate::predictor::PredictError;
use crate::store::history::HistoryEntry;
use crate::store::live::{self, MoveRefused, MoveRequest, Moved};
use crate::store::{Actor, WriteTransaction, model};

/// Longest reason, in characters.
const MAX_REASON_CHARS: usize = 1024;

/// The body of a promotion.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Promotion {
    version: Whole,
    reason: String,
    /// Needed for tainted versions.
    #[serde(default)]
    force: bool,
}

/// The body of a rollback.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rollback {
    version: Option<Whole>,
    reason: String,
    /// Needed for tainted versions.
    #[serde(default)]
    force: bool,
}

#[derive(Debug, Clone, Copy)]
enum Direction {
    Promote,
    Rollback,
}

/// `POST /v1/models/{model}/promote`
pub(super) async fn promote(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
    headers: HeaderMap,
    request: Repeatable,
    JsonBody { value, request_sha256 }: JsonBody<Promotion>,
) -> Result<Answer, Problem> {
    if let Some(answer) = request.recall(request_sha256).await? {
        return Ok(answer);
    }
    let wish = value.wish()?;
    let (tx, moved, answer) = make_move(&app, Direction::Promote, &model, &headers, &wish, &by).await?;
    finish(&app, &model, tx, &request, request_sha256, &moved, &answer).await?;
    Ok(answer)
}

/// `POST /v1/models/{model}/rollback`
pub(super) async fn rollback(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
    headers: HeaderMap,
    request: Repeatable,
    JsonBody { value, request_sha256 }: JsonBody<Rollback>,
) -> Result<Answer, Problem> {
    if let Some(answer) = request.recall(request_sha256).await? {
        return Ok(answer);
    }
    let wish = value.wish()?;
    let (tx, moved, answer) = make_move(&app, Direction::Rollback, &model, &headers, &wish, &by).await?;
    finish(&app, &model, tx, &request, request_sha256, &moved, &answer).await?;
    Ok(answer)
}

impl Promotion {
    /// What is asked for.
    pub(super) fn wish(&self) -> Result<MoveRequest<'_>, Problem> {
        wish(Some(self.version), &self.reason, self.force)
    }
}

impl Rollback {
    /// What is asked for.
    pub(super) fn wish(&self) -> Result<MoveRequest<'_>, Problem> {
        wish(self.version, &self.reason, self.force)
    }
}

fn wish(version: Option<Whole>, reason: &str, force: bool) -> Result<MoveRequest<'_>, Problem> {
    if !(1..=MAX_REASON_CHARS).contains(&reason.chars().count()) {
        let detail = format!("1 to {MAX_REASON_CHARS} characters");
        let error = InputError::at("/reason", "out_of_range", detail);
        return Err(Code::InvalidBody.because("a reason is needed for the history").with_error(error));
    }
    Ok(MoveRequest { version: version.map(|Whole(version)| version), reason, force })
}

async fn make_move(
    app: &AppState,
    direction: Direction,
    model: &Model,
    headers: &HeaderMap,
    wish: &MoveRequest<'_>,
    by: &Actor,
) -> Result<(WriteTransaction, Moved, Answer), Problem> {
    refuse_corrupt(app, model, direction, wish).await?;
    let mut tx = app.store.begin_for(by).await?;
    check_if_match(headers, &model::get(&mut tx, model.model_id).await?)?;
    let now = Timestamp::now();
    let moved = match direction {
        Direction::Promote => live::promote(&mut tx, model.model_id, wish, now).await?,
        Direction::Rollback => live::rollback(&mut tx, model.model_id, wish, now).await?,
    };
    let moved = moved.map_err(|refused| refusal(model, refused))?;
    let after = model::get(&mut tx, model.model_id).await?;
    let answer = Answer::ok(&json!({
        "model": model.name,
        "live": moved.live,
        "head": moved.head,
        "from": moved.from,
        "history_id": history_id(moved.history_id),
        "cancelled": moved.cancelled.iter().map(|&task| task_id(task)).collect::<Vec<_>>(),
    }))
    .with_header(&ETAG, etag(&after));
    Ok((tx, moved, answer))
}

/// Nothing moves to a version that could not be served.
async fn refuse_corrupt(
    app: &AppState,
    model: &Model,
    direction: Direction,
    wish: &MoveRequest<'_>,
) -> Result<(), Problem> {
    let target = match (wish.version, direction, model.live) {
        (None, Direction::Rollback, Some(live)) => app.store.parent(model.model_id, live).await?,
        (named, ..) => named,
    };
    let Some(target) = target else { return Ok(()) };
    match app.predictor.version(model.model_id, Some(target)).await {
        Err(error @ PredictError::Unusable(_)) => Err(Code::Corrupt.because(error.to_string())),
        // What else may be wrong with it, the move itself finds.
        _ => Ok(()),
    }
}

fn refusal(model: &Model, refused: MoveRefused) -> Problem {
    match refused {
        MoveRefused::UnknownVersion(version) => versions::missing(model.name.as_str(), version),
        MoveRefused::NothingLive => Code::NoLiveVersion.because(refused.to_string()),
        MoveRefused::Pruned(_) => Code::VersionPruned.because(refused.to_string()),
        MoveRefused::Tainted(_) => Code::VersionTainted.because(refused.to_string()),
        MoveRefused::NoParent(_) => Code::NoParentVersion.because(refused.to_string()),
    }
}

/// Commits, then tells those who compute: running tasks end, and the predictor serves the version before the answer.
async fn finish(
    app: &AppState,
    model: &Model,
    mut tx: WriteTransaction,
    request: &Repeatable,
    request_sha256: [u8; 32],
    moved: &Moved,
    answer: &Answer,
) -> Result<(), Problem> {
    request.keep(&mut tx, request_sha256, answer).await?;
    tx.commit().await?;
    tracing::info!(model = %model.name, live = moved.live, head = moved.head, from = moved.from, "live version moved");
    for &task in &moved.cancelled {
        app.scheduler.cancel(task);
    }
    app.predictor.refresh(model.model_id).await;
    app.scheduler.wake();
    Ok(())
}

fn history_id(row: i64) -> String {
    format!("h{row}")
}

fn body(entry: &HistoryEntry) -> Value {
    json!({
        "history_id": history_id(entry.history_id),
        "at": entry.at.to_string(),
        "action": entry.action,
        "from": entry.from_live,
        "live": entry.live,
        "from_head": entry.from_head,
        "head": entry.head,
        "reason": entry.reason,
        "actor": entry.actor,
        "report": entry.report.as_ref().map(report_body),
    })
}

/// `GET /v1/models/{model}/history`
pub(super) async fn history(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    page: Page,
) -> Result<Answer, Problem> {
    let entries = app.store.history(model.model_id, page.after, page.fetch()).await?;
    Ok(Answer::ok(&page.body("history", entries, |entry| entry.history_id, body)))
}
