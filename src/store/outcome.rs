//! How a task ends. Each way is one transaction of the caller's; a task that ended before is left alone.

use jiff::Timestamp;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, query};

use super::column::stored_time;
use super::new_version::{self, NewRegime, NewVersion, Place};
use super::pointers::{self, Pointers};
use super::{Purpose, StoreError, WriteTransaction, seal, taint};
use crate::consolidation::RegimeMemory;
use crate::lineage::{Promotion, TaskError};

/// What a finished task has to write.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The version.
    pub version: NewVersion,
    /// What to keep of the regime learned.
    pub memory: Option<RegimeMemory>,
    /// The regime's new test events.
    pub reservoir: Vec<i64>,
    /// Every regime of the line, in the order first learned.
    pub regimes: Vec<NewRegime>,
    /// What the policy decided.
    pub promotion: Promotion,
    /// The version that was live when it decided.
    pub judged_against: Option<i64>,
}

/// What a finished task wrote.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Finished {
    /// The new version, now the head.
    pub version: i64,
    /// Whether it is live.
    pub live: bool,
}

/// Why a finished task may not write its version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Overtaken {
    /// It was cancelled, by a rollback for one.
    #[error("the task is not running any more")]
    Ended,
    /// Somebody asked to cancel it.
    #[error("somebody asked to cancel the task")]
    CancelRequested,
    /// Another version went live since the policy decided; it has to decide again.
    #[error("another version went live")]
    LiveMoved,
}

/// Writes the version, what is remembered and how it drives; ends the task; moves the head, and live when promoted.
///
/// # Errors
/// When the database cannot be written.
pub async fn succeeded(
    transaction: &mut WriteTransaction,
    task_id: i64,
    outcome: &Outcome,
    now: Timestamp,
) -> Result<Result<Finished, Overtaken>, StoreError> {
    transaction.is_for(Purpose::TaskSucceeded);
    let task = query("select * from task where task_id = ?").bind(task_id).fetch_one(&mut **transaction).await?;
    let model_id: i64 = task.try_get("model_id")?;
    let before = pointers::read(transaction, model_id).await?;
    if let Some(overtaken) = overtaken(&task, &before, outcome)? {
        return Ok(Err(overtaken));
    }
    let place = Place {
        model_id,
        task_id: Some(task_id),
        parent: task.try_get("parent_version")?,
        stage: task.try_get("stage")?,
        regime: task.try_get("regime")?,
    };
    let version = new_version::insert(transaction, &place, &outcome.version, &outcome.promotion, now).await?;
    insert_regimes(transaction, model_id, version, outcome).await?;
    seal::seal(transaction).await?;
    taint::inherit(transaction, model_id, version, now).await?;
    query("update task set state = 'succeeded', version = ?, ended_at = ? where task_id = ?")
        .bind(version)
        .bind(stored_time(now))
        .bind(task_id)
        .execute(&mut **transaction)
        .await?;
    release(transaction, task_id, "learned").await?;
    let live = new_version::take_over(transaction, model_id, version, &outcome.promotion, &before, now).await?;
    Ok(Ok(Finished { version, live }))
}

fn overtaken(task: &SqliteRow, before: &Pointers, outcome: &Outcome) -> Result<Option<Overtaken>, StoreError> {
    let running = task.try_get::<&str, _>("state")? == "running";
    let parent: Option<i64> = task.try_get("parent_version")?;
    if !running || parent != before.head {
        return Ok(Some(Overtaken::Ended));
    }
    if task.try_get::<i64, _>("cancel_requested")? == 1 {
        return Ok(Some(Overtaken::CancelRequested));
    }
    Ok((outcome.judged_against != before.live).then_some(Overtaken::LiveMoved))
}

async fn insert_regimes(
    transaction: &mut WriteTransaction,
    model_id: i64,
    version: i64,
    outcome: &Outcome,
) -> Result<(), StoreError> {
    let anchor_id = match &outcome.memory {
        Some(memory) => Some(new_version::insert_anchor(transaction, model_id, memory).await?),
        None => None,
    };
    let reservoir_id = new_version::insert_reservoir(transaction, model_id, &outcome.reservoir).await?;
    new_version::insert_regimes(transaction, model_id, version, &outcome.regimes, (anchor_id, reservoir_id)).await
}

/// Ends a task that could not learn; its events are held. `false` when it had ended before.
///
/// # Errors
/// When the database cannot be written.
pub async fn failed(
    transaction: &mut WriteTransaction,
    task_id: i64,
    error: &TaskError,
    now: Timestamp,
) -> Result<bool, StoreError> {
    transaction.is_for(Purpose::TaskFailed);
    end_without_version(transaction, task_id, "failed", Some(error), now, "held").await
}

/// Ends a task that nobody wants any more; its events are set aside. `false` when it had ended before.
///
/// # Errors
/// When the database cannot be written.
pub async fn cancelled(transaction: &mut WriteTransaction, task_id: i64, now: Timestamp) -> Result<bool, StoreError> {
    transaction.is_for(Purpose::TaskCancelled);
    end_without_version(transaction, task_id, "cancelled", None, now, "set_aside").await
}

async fn end_without_version(
    transaction: &mut WriteTransaction,
    task_id: i64,
    state: &'static str,
    error: Option<&TaskError>,
    now: Timestamp,
    events: &'static str,
) -> Result<bool, StoreError> {
    let ended = query(
        "update task set state = ?, error_code = ?, error_detail = ?, ended_at = ?
         where task_id = ? and state in ('queued', 'running')",
    )
    .bind(state)
    .bind(error.map(|e| e.code.as_str()))
    .bind(error.map(|e| e.detail.as_str()))
    .bind(stored_time(now))
    .bind(task_id)
    .execute(&mut **transaction)
    .await?;
    if ended.rows_affected() == 0 {
        return Ok(false);
    }
    release(transaction, task_id, events).await?;
    pointers::learned_again(transaction, task_id).await?;
    Ok(true)
}

/// Gives back the events a task claimed, in the state its end leaves them in, and drops its checkpoint.
async fn release(transaction: &mut WriteTransaction, task_id: i64, state: &'static str) -> Result<(), StoreError> {
    query(
        "update event set state = ?
         where state = 'claimed' and event_id in (select event_id from task_event where task_id = ?)",
    )
    .bind(state)
    .bind(task_id)
    .execute(&mut **transaction)
    .await?;
    query("delete from checkpoint where task_id = ?").bind(task_id).execute(&mut **transaction).await?;
    Ok(())
}
