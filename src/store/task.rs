//! Tasks: reading, starting, cancelling, putting back. `selection` creates them, `outcome` ends them.

use jiff::Timestamp;
use serde_json::Value;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, query};

use super::column::{count, json, optional_count, optional_time, stored_time, time, word};
use super::outcome;
use super::{Purpose, Store, StoreError, WriteTransaction};
use crate::lineage::{Task, TaskError, TaskState};

/// What came of a wish to cancel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cancelled {
    /// It was waiting and is cancelled.
    AtOnce,
    /// It is running and ends at its next update, once the scheduler is told.
    Requested,
    /// It had ended before; nothing changed.
    AlreadyEnded(TaskState),
    /// The model has no such task.
    Unknown,
}

/// What came of starting a task.
#[derive(Debug, Clone, PartialEq)]
pub enum Start {
    /// It is running; parent and stage are fixed.
    Running(Box<Task>),
    /// Its process died too often; it failed.
    GivenUp,
    /// It is not waiting any more, was to be cancelled, or its model is paused.
    NotWaiting,
}

/// A task that could start, as the queue sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The task.
    pub task_id: i64,
    /// Its model's row id.
    pub model_id: i64,
    /// The share done at its last checkpoint.
    pub checkpointed: f64,
}

/// The columns of [`task_from`]; the rest of the statement follows.
macro_rules! select_task {
    ($rest:literal) => {
        concat!(
            "select t.task_id, t.model_id, t.kind, t.state, t.regime, t.settings, t.parent_version, t.stage, t.version, ",
            "t.attempt, t.replay_id, t.replays, t.error_code, t.error_detail, t.created_at, t.started_at, t.ended_at, ",
            "c.share, r.report, ",
            "(select json_group_array(batch_id) from (select batch_id from task_batch b ",
            "where b.task_id = t.task_id order by batch_id)) as batches, ",
            "(select json_group_array(json_object('task_id', p.task_id, 'state', p.state, ",
            "'checkpointed', coalesce((select share from checkpoint d where d.task_id = p.task_id), 0.0))) ",
            "from (select q.task_id, q.state from task q where q.replay_id = t.task_id ",
            "order by q.place, q.task_id) p) as parts ",
            "from task t left join checkpoint c on c.task_id = t.task_id left join replay r on r.task_id = t.task_id ",
            $rest
        )
    };
}

fn task_from(row: &SqliteRow) -> Result<Task, StoreError> {
    let error_code: Option<String> = row.try_get("error_code")?;
    let error_detail: Option<String> = row.try_get("error_detail")?;
    Ok(Task {
        task_id: row.try_get("task_id")?,
        model_id: row.try_get("model_id")?,
        kind: word(row, "kind")?,
        state: word(row, "state")?,
        regime: word(row, "regime")?,
        settings: json::<Value>(row, "settings")?,
        batches: json(row, "batches")?,
        parent: row.try_get("parent_version")?,
        stage: optional_count(row, "stage")?,
        version: row.try_get("version")?,
        attempt: count(row, "attempt")?,
        checkpointed: row.try_get::<Option<f64>, _>("share")?.unwrap_or(0.0),
        part_of: row.try_get("replay_id")?,
        replays: row.try_get("replays")?,
        parts: json(row, "parts")?,
        report: json(row, "report")?,
        error: error_code.map(|code| TaskError { code, detail: error_detail.unwrap_or_default() }),
        created_at: time(row, "created_at")?,
        started_at: optional_time(row, "started_at")?,
        ended_at: optional_time(row, "ended_at")?,
    })
}

impl Store {
    /// The task, when the model has it.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn task(&self, model_id: i64, task_id: i64) -> Result<Option<Task>, StoreError> {
        let row = query(select_task!("where t.task_id = ? and t.model_id = ?"))
            .bind(task_id)
            .bind(model_id)
            .fetch_optional(&self.readers)
            .await?;
        row.as_ref().map(task_from).transpose()
    }

    /// At most `limit` tasks of the model with ids above `after`, ascending.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn tasks(&self, model_id: i64, after: i64, limit: u32) -> Result<Vec<Task>, StoreError> {
        let rows = query(select_task!("where t.model_id = ? and t.task_id > ? order by t.task_id limit ?"))
            .bind(model_id)
            .bind(after)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(task_from).collect()
    }

    /// The next task of every model that is not paused: one whose end could not be written, else a part of a replay, else a
    /// replay whose parts have ended, else the oldest.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn candidates(&self) -> Result<Vec<Candidate>, StoreError> {
        let rows = query(
            "select first.model_id, first.task_id, coalesce(c.share, 0.0) as share from (
                 select t.model_id, t.task_id,
                     min(case when t.state = 'running' then -9e18 else coalesce(t.place, t.task_id) end) as turn
                 from task t join model m on m.model_id = t.model_id
                 where t.state in ('queued', 'running') and m.paused = 0
                 group by t.model_id
             ) first left join checkpoint c on c.task_id = first.task_id order by first.task_id",
        )
        .fetch_all(&self.readers)
        .await?;
        let candidate = |row: &SqliteRow| {
            let (task_id, model_id) = (row.try_get("task_id")?, row.try_get("model_id")?);
            Ok(Candidate { task_id, model_id, checkpointed: row.try_get("share")? })
        };
        rows.iter().map(candidate).collect()
    }
}

/// The task as this transaction sees it.
///
/// # Errors
/// When the database cannot be read.
pub async fn get(connection: &mut SqliteConnection, task_id: i64) -> Result<Option<Task>, StoreError> {
    let row = query(select_task!("where t.task_id = ?")).bind(task_id).fetch_optional(connection).await?;
    row.as_ref().map(task_from).transpose()
}

/// When a process begins: puts the tasks that the one before left running back in line, first of their models as before,
/// and ends those that somebody had asked to cancel. Gives the ids of all of them.
///
/// Until then a task looks as if it ran, and a wish to cancel it would wait for a job that nobody has; for ever, when
/// its model is paused.
///
/// # Errors
/// When the database cannot be written.
pub async fn take_over(transaction: &mut WriteTransaction, now: Timestamp) -> Result<Vec<i64>, StoreError> {
    transaction.is_for(Purpose::TaskTakenOver);
    // In these words the index of active tasks is found, and not every task ever made is looked at.
    let rows = query(
        "update task set state = 'queued', crashes = crashes + 1
         where state in ('queued', 'running') and state = 'running' returning task_id, cancel_requested",
    )
    .fetch_all(&mut **transaction)
    .await?;
    let mut left = Vec::with_capacity(rows.len());
    for row in &rows {
        let task_id = row.try_get("task_id")?;
        if row.try_get::<i64, _>("cancel_requested")? == 1 {
            outcome::cancelled(transaction, task_id, now).await?;
        }
        left.push(task_id);
    }
    Ok(left)
}

/// Starts or resumes a task. The first start fixes its parent, the head, and its stage; a replay has neither of its own.
///
/// A task found running was left by a job whose end could not be written, which counts as a crash; after more than
/// `max_crashes` without a checkpoint in between it fails.
///
/// # Errors
/// When the database cannot be written.
pub async fn start(
    transaction: &mut WriteTransaction,
    task_id: i64,
    max_crashes: u32,
    now: Timestamp,
) -> Result<Start, StoreError> {
    transaction.is_for(Purpose::TaskStarted);
    let found = query(
        "update task set
             crashes = crashes + (state = 'running'),
             attempt = attempt + 1,
             parent_version = case when stage is null and kind = 'learn'
                              then (select head_version from model m where m.model_id = task.model_id)
                              else parent_version end,
             stage = case when kind = 'learn' then coalesce(stage, 1 + coalesce(
                              (select v.stage from version v join model m using (model_id)
                               where m.model_id = task.model_id and v.version = m.head_version), 0)) end,
             state = 'running',
             started_at = coalesce(started_at, ?)
         where task_id = ? and state in ('queued', 'running')
             and (select paused from model m where m.model_id = task.model_id) = 0
         returning crashes, cancel_requested",
    )
    .bind(stored_time(now))
    .bind(task_id)
    .fetch_optional(&mut **transaction)
    .await?;
    let Some(row) = found else { return Ok(Start::NotWaiting) };
    let crashes: u32 = count(&row, "crashes")?;
    if crashes > max_crashes {
        let error = TaskError {
            code: "internal".to_owned(),
            detail: format!("the server ended {crashes} times while the task ran from the same checkpoint"),
        };
        outcome::failed(transaction, task_id, &error, now).await?;
        return Ok(Start::GivenUp);
    }
    if row.try_get::<i64, _>("cancel_requested")? == 1 {
        // Somebody asked before the process died.
        outcome::cancelled(transaction, task_id, now).await?;
        return Ok(Start::NotWaiting);
    }
    let task = get(transaction, task_id).await?;
    Ok(task.map_or(Start::NotWaiting, |task| Start::Running(Box::new(task))))
}

/// Puts a running task back in line, first of its model as before; it goes on from its checkpoint.
///
/// # Errors
/// When the database cannot be written.
pub async fn put_back(transaction: &mut WriteTransaction, task_id: i64) -> Result<(), StoreError> {
    transaction.is_for(Purpose::TaskPutBack);
    query("update task set state = 'queued' where task_id = ? and state = 'running'")
        .bind(task_id)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

/// Cancels a waiting task at once, and asks a running one to end.
///
/// # Errors
/// When the database cannot be written.
pub async fn cancel(
    transaction: &mut WriteTransaction,
    model_id: i64,
    task_id: i64,
    now: Timestamp,
) -> Result<Cancelled, StoreError> {
    let row = query("select state from task where task_id = ? and model_id = ?")
        .bind(task_id)
        .bind(model_id)
        .fetch_optional(&mut **transaction)
        .await?;
    let Some(row) = row else { return Ok(Cancelled::Unknown) };
    match word(&row, "state")? {
        TaskState::Queued => {
            outcome::cancelled(transaction, task_id, now).await?;
            Ok(Cancelled::AtOnce)
        }
        TaskState::Running => {
            transaction.is_for(Purpose::TaskCancelRequested);
            query("update task set cancel_requested = 1 where task_id = ?")
                .bind(task_id)
                .execute(&mut **transaction)
                .await?;
            Ok(Cancelled::Requested)
        }
        ended => Ok(Cancelled::AlreadyEnded(ended)),
    }
}

/// Whether the task is running: neither ended nor put back in line.
///
/// # Errors
/// When the database cannot be read.
pub async fn is_running(connection: &mut SqliteConnection, task_id: i64) -> Result<bool, StoreError> {
    let row = query("select 1 from task where task_id = ? and state = 'running'")
        .bind(task_id)
        .fetch_optional(connection)
        .await?;
    Ok(row.is_some())
}

/// Whether somebody asked to cancel the task.
///
/// # Errors
/// When the database cannot be read.
pub async fn cancel_requested(connection: &mut SqliteConnection, task_id: i64) -> Result<bool, StoreError> {
    let row =
        query("select cancel_requested from task where task_id = ?").bind(task_id).fetch_optional(connection).await?;
    Ok(row.is_some_and(|row| row.get::<i64, _>("cancel_requested") == 1))
}
