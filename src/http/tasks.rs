//! `/v1/models/{model}/tasks`: ask for learning, wait for it, end it.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::LOCATION;
use jiff::Timestamp;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::time::Instant;

use super::answer::Answer;
use super::body::JsonBody;
use super::idempotency::Repeatable;
use super::object::Object;
use super::once::Once;
use super::path::{ModelAt, TaskAt, batch_id, parse_id, task_id};
use super::problem::{Code, InputError, Problem};
use super::query::{Page, Query};
use super::replay::report_body;
use super::{AppState, ServerSettings};
use crate::lineage::{Model, ModelSettings, RegimeName, ReplayPart, Task, TaskState};
use crate::store::Actor;
use crate::store::selection::{self, NoTask, Selection, TaskRequest};
use crate::store::task::{self, Cancelled};

/// The body of a wish for learning.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NewTask {
    batches: Batches,
    regime: Option<RegimeName>,
    #[serde(rename = "where")]
    only: Option<Object<Only>>,
    #[serde(default)]
    settings: Once,
}

#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "\"pending\" or an array of batch ids is needed")]
enum Batches {
    Pending(Pending),
    Named(Vec<String>),
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Pending {
    Pending,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Only {
    mean_speed_mps: [f64; 2],
}

/// How long to wait for a final state.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wait {
    wait_s: Option<f64>,
}

impl Wait {
    /// How long that is.
    pub(super) fn patience(&self, settings: &ServerSettings) -> Result<Duration, Problem> {
        let (wait_s, most) = (self.wait_s.unwrap_or(0.0), settings.wait_max_s);
        if !(0.0..=most).contains(&wait_s) {
            let error = InputError::parameter("wait_s", "out_of_range", format!("0 to {most}"));
            return Err(Code::InvalidQuery.because(format!("wait_s must be within 0 to {most}")).with_error(error));
        }
        Ok(Duration::from_secs_f64(wait_s))
    }
}

/// Share done, 0–1.
fn share(app: &AppState, task_id: i64, state: TaskState, checkpointed: f64) -> f64 {
    match state {
        TaskState::Succeeded => 1.0,
        TaskState::Running => app.scheduler.progress(task_id).map_or(checkpointed, |progress| progress.borrow().share),
        _ => checkpointed,
    }
}

/// Share done; of a replay, that of its parts and of its own measuring as one more.
fn progress(app: &AppState, task: &Task) -> f64 {
    let own = share(app, task.task_id, task.state, task.checkpointed);
    let part = |part: &ReplayPart| {
        let done = part.state.is_final();
        if done { 1.0 } else { share(app, part.task_id, part.state, part.checkpointed) }
    };
    match task.state {
        TaskState::Succeeded => own,
        _ => (own + task.parts.iter().map(part).sum::<f64>()) / (1 + task.parts.len()) as f64,
    }
}

/// A task as clients see it.
pub(super) fn body(app: &AppState, model: &Model, task: &Task) -> Value {
    json!({
        "task_id": task_id(task.task_id),
        "model": model.name,
        "kind": task.kind,
        "state": task.state,
        "regime": task.regime,
        "stage": task.stage,
        "batches": task.batches.iter().map(|&batch| batch_id(batch)).collect::<Vec<_>>(),
        "parent": task.parent,
        "version": task.version,
        "attempt": task.attempt,
        "progress": progress(app, task),
        "part_of": task.part_of.map(task_id),
        "replays": task.replays,
        "parts": task.parts.iter().map(|part| task_id(part.task_id)).collect::<Vec<_>>(),
        "report": task.report.as_ref().map(report_body),
        "error": task.error,
        "settings": task.settings,
        "created_at": task.created_at.to_string(),
        "started_at": task.started_at.map(|at| at.to_string()),
        "ended_at": task.ended_at.map(|at| at.to_string()),
    })
}

/// The task, or a 404.
pub(super) async fn find(app: &AppState, model: &Model, task: i64) -> Result<Task, Problem> {
    let missing = || Code::TaskNotFound.because(format!("{} has no task {}", model.name, task_id(task)));
    app.store.task(model.model_id, task).await?.ok_or_else(missing)
}

/// `POST /v1/models/{model}/tasks`
pub(super) async fn create(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
    request: Repeatable,
    JsonBody { value: new, request_sha256 }: JsonBody<NewTask>,
) -> Result<Answer, Problem> {
    if let Some(answer) = request.recall(request_sha256).await? {
        return Ok(answer);
    }
    let wish = wish(&model.settings, new)?;
    let mut tx = app.store.begin_for(&by).await?;
    let made = selection::create_tasks(&mut tx, model.model_id, &wish, Timestamp::now()).await?;
    let made = made.map_err(|refused| refusal(&wish, &refused))?;
    let first = *made.first().ok_or_else(|| Problem::internal("a request made no task and was not refused"))?;
    let first = task::get(&mut tx, first).await?.ok_or_else(|| Problem::internal("a new task is missing"))?;
    let mut shown = body(&app, &model, &first);
    shown["task_ids"] = made.iter().map(|&task| task_id(task)).collect();
    let location = format!("/v1/models/{}/tasks/{}", model.name, task_id(first.task_id));
    let answer = Answer::json(StatusCode::ACCEPTED, &shown).with_header(&LOCATION, location);
    request.keep(&mut tx, request_sha256, &answer).await?;
    tx.commit().await?;
    app.scheduler.wake();
    Ok(answer)
}

/// What is asked for, of a model with these settings.
pub(super) fn wish(settings: &ModelSettings, new: NewTask) -> Result<TaskRequest, Problem> {
    let selection = match new.batches {
        Batches::Pending(Pending::Pending) => Selection::Pending { regime: new.regime },
        Batches::Named(ids) => Selection::Batches { batches: rows(&ids)?, regime: new.regime },
    };
    let mean_speed_mps = new.only.map(|Object(only)| only.mean_speed_mps);
    if mean_speed_mps.is_some_and(|[low, high]| low > high) {
        let error = InputError::at("/where/mean_speed_mps", "out_of_range", "[low, high] with low <= high is needed");
        return Err(Code::InvalidBody.because("no speed lies in this band").with_error(error));
    }
    let Once(changes) = new.settings;
    settings.for_task(&changes)?;
    Ok(TaskRequest { selection, mean_speed_mps, settings: changes })
}

fn rows(ids: &[String]) -> Result<Vec<i64>, Problem> {
    if ids.is_empty() {
        let error = InputError::at("/batches", "empty", "at least one batch, or \"pending\"");
        return Err(Code::InvalidBody.because("no batch is named").with_error(error));
    }
    let errors: Vec<_> = ids
        .iter()
        .enumerate()
        .filter(|(_, id)| parse_id("b", id).is_none())
        .map(|(at, id)| InputError::at(format!("/batches/{at}"), "unknown_batch", format!("{id:?} is no batch")))
        .collect();
    if !errors.is_empty() {
        return Err(Code::InvalidBody.because("a batch is unknown").with_errors(errors));
    }
    Ok(ids.iter().filter_map(|id| parse_id("b", id)).collect())
}

fn refusal(wish: &TaskRequest, refused: &NoTask) -> Problem {
    let at = |batch: i64| {
        let position = match &wish.selection {
            Selection::Batches { batches, .. } => batches.iter().position(|&named| named == batch),
            Selection::Pending { .. } => None,
        };
        format!("/batches/{}", position.unwrap_or_default())
    };
    match *refused {
        NoTask::NothingPending => Code::NothingPending.because(refused.to_string()),
        NoTask::UnknownBatch(batch) => {
            let detail = format!("the model has no batch {}", batch_id(batch));
            Code::InvalidBody.because(detail.clone()).with_error(InputError::at(at(batch), "unknown_batch", detail))
        }
        NoTask::RetractedBatch(batch) => {
            let detail = format!("{} was retracted", batch_id(batch));
            Code::BatchRetracted.because(detail.clone()).with_error(InputError::at(at(batch), "retracted", detail))
        }
    }
}

/// `GET /v1/models/{model}/tasks`
pub(super) async fn list(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    page: Page,
) -> Result<Answer, Problem> {
    let tasks = app.store.tasks(model.model_id, page.after, page.fetch()).await?;
    Ok(Answer::ok(&page.body("tasks", tasks, |task| task.task_id, |task| body(&app, &model, task))))
}

/// `GET /v1/models/{model}/tasks/{task_id}`
pub(super) async fn read(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    TaskAt(task): TaskAt,
    Query(asked): Query<Wait>,
) -> Result<Answer, Problem> {
    let task = wait(&app, &model, task, asked.patience(&app.settings)?).await?;
    Ok(Answer::ok(&body(&app, &model, &task)))
}

/// The task at a final state, or as it stands when the time is up or the server stops.
async fn wait(app: &AppState, model: &Model, task: i64, patience: Duration) -> Result<Task, Problem> {
    let until = Instant::now() + patience;
    let (mut changes, mut stopping) = (app.scheduler.changes(), app.stopping.clone());
    loop {
        changes.borrow_and_update();
        let found = find(app, model, task).await?;
        if found.state.is_final() {
            // What it made serves moments after its end is stored; who waited for it may rely on that.
            let _ = tokio::time::timeout(Duration::from_secs(1), app.scheduler.left(task)).await;
            return Ok(found);
        }
        tokio::select! {
            changed = changes.changed() => if changed.is_err() { return Ok(found) },
            () = tokio::time::sleep_until(until) => return Ok(found),
            _ = stopping.wait_for(|&stop| stop) => return Ok(found),
        }
    }
}

/// `POST /v1/models/{model}/tasks/{task_id}/cancel`
pub(super) async fn cancel(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    TaskAt(task): TaskAt,
    by: Actor,
) -> Result<Answer, Problem> {
    let mut tx = app.store.begin_for(&by).await?;
    match task::cancel(&mut tx, model.model_id, task, Timestamp::now()).await? {
        Cancelled::AtOnce | Cancelled::Requested => {}
        Cancelled::AlreadyEnded(state) => {
            return Err(Code::TaskEnded.because(format!("{} has ended: {}", task_id(task), state.as_str())));
        }
        Cancelled::Unknown => return find(&app, &model, task).await.map(|_| unreachable!("it is unknown")),
    }
    // Of a replay nobody wants the rest either.
    let parts: Vec<_> = task::get(&mut tx, task).await?.into_iter().flat_map(|task| task.parts).collect();
    for part in &parts {
        task::cancel(&mut tx, model.model_id, part.task_id, Timestamp::now()).await?;
    }
    tx.commit().await?;
    for part in &parts {
        app.scheduler.cancel(part.task_id);
    }
    app.scheduler.cancel(task);
    Ok(Answer::ok(&body(&app, &model, &find(&app, &model, task).await?)))
}
