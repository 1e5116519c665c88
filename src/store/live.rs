//! Promote and rollback: who serves, and where learning goes on.

use jiff::Timestamp;
use sqlx::{Row, query};

use super::history::{self, Action, Change};
use super::pointers::{self, Pointers};
use super::{Purpose, StoreError, WriteTransaction, outcome, prune, taint, version};

/// A wish to move live (and, for a rollback, head).
#[derive(Debug, Clone, Copy)]
pub struct MoveRequest<'a> {
    /// Where to; a rollback's default is the live version's parent.
    pub version: Option<i64>,
    /// Why.
    pub reason: &'a str,
    /// Also to a version that learned what was retracted later.
    pub force: bool,
}

/// A move that was made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Moved {
    /// The version that serves now.
    pub live: Option<i64>,
    /// The version the next task starts from.
    pub head: Option<i64>,
    /// The version that served before.
    pub from: Option<i64>,
    /// Its entry in the history.
    pub history_id: i64,
    /// Tasks it cancelled; the scheduler is to be told, some may be running.
    pub cancelled: Vec<i64>,
}

/// Why a move was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MoveRefused {
    /// The model has no such version.
    #[error("the model has no version {0}")]
    UnknownVersion(i64),
    /// A rollback without a version, and nothing is live.
    #[error("nothing is live, so there is nothing to roll back from")]
    NothingLive,
    /// A rollback without a version, and the live one is the first of its line.
    #[error("version {0} is live and has no parent to roll back to")]
    NoParent(i64),
    /// The version learned what was retracted later, and nobody insists.
    #[error("version {0} learned what was retracted later; say \"force\": true to let it serve all the same")]
    Tainted(i64),
    /// The version's weights were not kept.
    #[error("version {0} is pruned: retention did not keep its weights")]
    Pruned(i64),
}

/// Moves live to the named version; head and tasks stay.
///
/// # Errors
/// When the database cannot be written.
pub async fn promote(
    transaction: &mut WriteTransaction,
    model_id: i64,
    request: &MoveRequest<'_>,
    now: Timestamp,
) -> Result<Result<Moved, MoveRefused>, StoreError> {
    transaction.is_for(Purpose::Promoted);
    let before = pointers::read(transaction, model_id).await?;
    let target = match target(transaction, model_id, &before, request).await? {
        Ok(target) => target,
        Err(refused) => return Ok(Err(refused)),
    };
    let after = Pointers { live: Some(target), ..before };
    let history_id = write(transaction, model_id, Action::Promote, &before, &after, request, now).await?;
    Ok(Ok(Moved { live: after.live, head: after.head, from: before.live, history_id, cancelled: Vec::new() }))
}

/// Moves live and head to the named version, cancels queued and running tasks, and sets aside the events that only
/// abandoned versions had learned.
///
/// # Errors
/// When the database cannot be written.
pub async fn rollback(
    transaction: &mut WriteTransaction,
    model_id: i64,
    request: &MoveRequest<'_>,
    now: Timestamp,
) -> Result<Result<Moved, MoveRefused>, StoreError> {
    transaction.is_for(Purpose::RolledBack);
    let before = pointers::read(transaction, model_id).await?;
    let target = match target(transaction, model_id, &before, request).await? {
        Ok(target) => target,
        Err(refused) => return Ok(Err(refused)),
    };
    let after = Pointers { live: Some(target), head: Some(target), ..before };
    let history_id = write(transaction, model_id, Action::Rollback, &before, &after, request, now).await?;
    let active =
        query("select task_id from task where model_id = ? and state in ('queued', 'running') order by task_id")
            .bind(model_id)
            .fetch_all(&mut **transaction)
            .await?;
    let cancelled = active.iter().map(|row| row.try_get("task_id")).collect::<Result<Vec<i64>, _>>()?;
    for &task_id in &cancelled {
        outcome::cancelled(transaction, task_id, now).await?;
    }
    pointers::settle_events(transaction, model_id).await?;
    Ok(Ok(Moved { live: after.live, head: after.head, from: before.live, history_id, cancelled }))
}

/// Where to, when that may be.
async fn target(
    transaction: &mut WriteTransaction,
    model_id: i64,
    before: &Pointers,
    request: &MoveRequest<'_>,
) -> Result<Result<i64, MoveRefused>, StoreError> {
    let target = match request.version {
        Some(named) => named,
        None => match parent_of_live(transaction, model_id, before).await? {
            Ok(parent) => parent,
            refused => return Ok(refused),
        },
    };
    Ok(if !version::exists(transaction, model_id, target).await? {
        Err(MoveRefused::UnknownVersion(target))
    } else if prune::is_pruned(transaction, model_id, target).await? {
        Err(MoveRefused::Pruned(target))
    } else if !request.force && taint::is_tainted(transaction, model_id, target).await? {
        Err(MoveRefused::Tainted(target))
    } else {
        Ok(target)
    })
}

async fn parent_of_live(
    transaction: &mut WriteTransaction,
    model_id: i64,
    before: &Pointers,
) -> Result<Result<i64, MoveRefused>, StoreError> {
    let Some(live) = before.live else { return Ok(Err(MoveRefused::NothingLive)) };
    let row = query("select parent from version where model_id = ? and version = ?")
        .bind(model_id)
        .bind(live)
        .fetch_one(&mut **transaction)
        .await?;
    Ok(row.try_get::<Option<i64>, _>("parent")?.ok_or(MoveRefused::NoParent(live)))
}

async fn write(
    transaction: &mut WriteTransaction,
    model_id: i64,
    action: Action,
    before: &Pointers,
    after: &Pointers,
    request: &MoveRequest<'_>,
    now: Timestamp,
) -> Result<i64, StoreError> {
    pointers::write(transaction, model_id, after).await?;
    let change = Change { model_id, action, before, after, reason: request.reason, report: None };
    history::write(transaction, &change, now).await
}

#[cfg(test)]
#[path = "live_tests.rs"]
mod tests;
