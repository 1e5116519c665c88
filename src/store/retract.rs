//! Retracting a batch: what no other batch holds leaves every task, and what was learned of it is learned again without it.

use jiff::Timestamp;
use sqlx::{Row, query};

use super::column::{stored_time, word};
use super::history::{self, Action, Change};
use super::line::with_line;
use super::pointers::{self, Pointers};
use super::replay::LineStage;
use super::{Purpose, StoreError, WriteTransaction, outcome, prune, replay, taint};
use crate::lineage::{RegimeName, TaskState};

/// What came of a wish to retract.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Retracted {
    /// No version that counts had learned it.
    Done {
        /// Its events that no other batch holds are retracted: so many.
        events: u64,
        /// Running tasks that go on without these events, or not at all; the scheduler is to be told.
        stopped: Vec<i64>,
    },
    /// A version had learned some of these events.
    Replaying {
        /// The replay: its own, or one under way that is all that is left to do.
        task_id: i64,
        /// As above.
        stopped: Vec<i64>,
    },
    /// Nothing may be changed: this version would have to be learned again, and arrays of its events were not kept.
    Pruned {
        /// The version.
        version: i64,
    },
    /// It was retracted before; nothing changed.
    Before {
        /// Its replay, where one has not ended yet.
        replaying: Option<i64>,
    },
    /// The model has no such batch.
    Unknown,
}

/// A task that has some of the events that leave.
struct Holder {
    task_id: i64,
    state: TaskState,
    regime: RegimeName,
    part_of: Option<i64>,
}

/// Retracts a batch. Queued and running tasks go on without the events that only it held, and end where nothing is left for
/// training. Versions that learned some of these are tainted; where the head's line did, the head moves to before the first
/// of them, and the stages from there on become the parts of a replay, before everything else that waits. Where the answer
/// is [`Retracted::Pruned`] the transaction is to be dropped.
///
/// # Errors
/// When the database cannot be written.
pub async fn retract(
    transaction: &mut WriteTransaction,
    model_id: i64,
    batch_id: i64,
    now: Timestamp,
) -> Result<Retracted, StoreError> {
    transaction.is_for(Purpose::BatchRetracted);
    let row = query("select retracted_at from batch where batch_id = ? and model_id = ?")
        .bind(batch_id)
        .bind(model_id)
        .fetch_optional(&mut **transaction)
        .await?;
    let Some(row) = row else { return Ok(Retracted::Unknown) };
    if row.try_get::<Option<String>, _>("retracted_at")?.is_some() {
        return Ok(Retracted::Before { replaying: replay::under_way(transaction, batch_id).await? });
    }
    let events = take_away(transaction, batch_id, now).await?;
    let holders = holders(transaction, batch_id).await?;
    let with = |state: fn(TaskState) -> bool| holders.iter().filter(move |it| state(it.state)).map(|it| it.task_id);
    let learned: Vec<i64> = with(|state| state == TaskState::Succeeded).collect();
    let before = pointers::read(transaction, model_id).await?;
    let line = line(transaction, model_id).await?;
    let first = line.iter().position(|stage| stage.task_id.is_some_and(|task_id| learned.contains(&task_id)));
    let again = match first {
        Some(first) => &line[beginning(transaction, model_id, &line, first).await?..],
        None => &[],
    };
    if let Some(version) = lost(transaction, again).await? {
        return Ok(Retracted::Pruned { version });
    }
    let newly_tainted = taint::mark(transaction, model_id, batch_id, &learned, now).await?;
    if let Some(stage) = again.first() {
        let after = Pointers { head: stage.parent, ..before };
        pointers::write(transaction, model_id, &after).await?;
        let reason = format!("batch b{batch_id} was retracted");
        let change =
            Change { model_id, action: Action::Retract, before: &before, after: &after, reason: &reason, report: None };
        history::write(transaction, &change, now).await?;
        pointers::settle_events(transaction, model_id).await?;
    }
    let mut stopped = Vec::new();
    for task_id in with(|state| !state.is_final()) {
        stopped.extend(strip(transaction, task_id, batch_id, now).await?);
    }
    if !again.is_empty() {
        stopped.extend(begin_again(transaction, model_id).await?);
    }
    if !newly_tainted && again.is_empty() {
        // What is being learned again is learned without these events too.
        let joined = holders.iter().filter(|it| !it.state.is_final()).find_map(|it| it.part_of);
        return Ok(match joined {
            Some(task_id) => Retracted::Replaying { task_id, stopped },
            None => Retracted::Done { events, stopped },
        });
    }
    let regime = holders.iter().find(|it| it.state == TaskState::Succeeded).map(|it| &it.regime);
    let regime =
        regime.ok_or_else(|| StoreError::malformed("task", "no task made a version that learned the batch"))?;
    let wish = replay::NewReplay { model_id, batch_id, regime, from_head: before.head, stages: again };
    let task_id = replay::create(transaction, &wish, now).await?;
    Ok(Retracted::Replaying { task_id, stopped })
}

/// Retracts the events of a batch that no other holds, and gives the others to those that do. Tells how many were retracted.
async fn take_away(transaction: &mut WriteTransaction, batch_id: i64, now: Timestamp) -> Result<u64, StoreError> {
    query("update batch set retracted_at = ? where batch_id = ?")
        .bind(stored_time(now))
        .bind(batch_id)
        .execute(&mut **transaction)
        .await?;
    let retracted = query(
        "update event set state = 'retracted' where event_id in (select event_id from batch_event where batch_id = ?)
             and not exists (select 1 from batch_event o join batch b using (batch_id)
                             where o.event_id = event.event_id and b.retracted_at is null)",
    )
    .bind(batch_id)
    .execute(&mut **transaction)
    .await?;
    query(
        "update event set batch_id = (select min(b.batch_id) from batch_event o join batch b using (batch_id)
                                      where o.event_id = event.event_id and b.retracted_at is null)
         where batch_id = ?1 and state <> 'retracted'
             and event_id in (select event_id from batch_event where batch_id = ?1)",
    )
    .bind(batch_id)
    .execute(&mut **transaction)
    .await?;
    Ok(retracted.rows_affected())
}

/// Every task that has retracted events of this batch, ascending.
async fn holders(transaction: &mut WriteTransaction, batch_id: i64) -> Result<Vec<Holder>, StoreError> {
    let rows = query(
        "select t.task_id, t.state, t.regime, t.replay_id from task t where t.task_id in (
             select te.task_id from batch_event be cross join event e on e.event_id = be.event_id
             cross join task_event te on te.event_id = e.event_id
             where be.batch_id = ? and e.state = 'retracted'
         ) order by t.task_id",
    )
    .bind(batch_id)
    .fetch_all(&mut **transaction)
    .await?;
    rows.iter()
        .map(|row| {
            Ok(Holder {
                task_id: row.try_get("task_id")?,
                state: word(row, "state")?,
                regime: word(row, "regime")?,
                part_of: row.try_get("replay_id")?,
            })
        })
        .collect()
}

/// The head's line, from its first version on.
async fn line(transaction: &mut WriteTransaction, model_id: i64) -> Result<Vec<LineStage>, StoreError> {
    let rows = query(with_line!(
        "(select head_version from model where model_id = ?1)",
        "select line.version, line.parent, line.task_id from line"
    ))
    .bind(model_id)
    .fetch_all(&mut **transaction)
    .await?;
    let stages = rows.iter().rev().map(|row| {
        Ok(LineStage {
            version: row.try_get("version")?,
            parent: row.try_get("parent")?,
            task_id: row.try_get("task_id")?,
        })
    });
    stages.collect()
}

/// The stage to begin with: the first that has to be learned again, or the last before it whose parent has its weights.
async fn beginning(
    transaction: &mut WriteTransaction,
    model_id: i64,
    line: &[LineStage],
    first: usize,
) -> Result<usize, StoreError> {
    for (at, stage) in line[..=first].iter().enumerate().rev() {
        match stage.parent {
            Some(parent) if prune::is_pruned(transaction, model_id, parent).await? => {}
            _ => return Ok(at),
        }
    }
    Ok(0)
}

/// A version whose stage cannot be learned again.
async fn lost(transaction: &mut WriteTransaction, stages: &[LineStage]) -> Result<Option<i64>, StoreError> {
    for stage in stages {
        let Some(task_id) = stage.task_id else { return Ok(Some(stage.version)) };
        if prune::lost_events(transaction, task_id).await? {
            return Ok(Some(stage.version));
        }
    }
    Ok(None)
}

/// Takes retracted events of the batch out of a task that waits or runs; where it ran, it is back in line. A task with
/// nothing left for training is cancelled. Gives its id when it ran.
async fn strip(
    transaction: &mut WriteTransaction,
    task_id: i64,
    batch_id: i64,
    now: Timestamp,
) -> Result<Option<i64>, StoreError> {
    let ran = super::task::is_running(transaction, task_id).await?;
    query(
        "delete from task_event where task_id = ?1 and event_id in (
             select e.event_id from task_event te cross join event e on e.event_id = te.event_id
             where te.task_id = ?1 and e.state = 'retracted')",
    )
    .bind(task_id)
    .execute(&mut **transaction)
    .await?;
    query("delete from task_batch where task_id = ? and batch_id = ?")
        .bind(task_id)
        .bind(batch_id)
        .execute(&mut **transaction)
        .await?;
    replay::note_batches(transaction, task_id).await?;
    if replay::can_train(transaction, task_id).await? {
        put_back_unstarted(transaction, task_id).await?;
    } else {
        outcome::cancelled(transaction, task_id, now).await?;
    }
    Ok(ran.then_some(task_id))
}

/// A task that has begun begins again where the head is by then.
async fn put_back_unstarted(transaction: &mut WriteTransaction, task_id: i64) -> Result<(), StoreError> {
    query(
        "update task set state = 'queued', stage = null,
             parent_version = case when kind = 'learn' then null else parent_version end
         where task_id = ?",
    )
    .bind(task_id)
    .execute(&mut **transaction)
    .await?;
    query("delete from checkpoint where task_id = ?").bind(task_id).execute(&mut **transaction).await?;
    Ok(())
}

/// After the head moved: every task of the model that has begun begins again. Gives those that ran.
async fn begin_again(transaction: &mut WriteTransaction, model_id: i64) -> Result<Vec<i64>, StoreError> {
    let rows = query(
        "select task_id, state = 'running' as ran from task where model_id = ? and state in ('queued', 'running')
             and (stage is not null or state = 'running') order by task_id",
    )
    .bind(model_id)
    .fetch_all(&mut **transaction)
    .await?;
    let mut ran = Vec::new();
    for row in &rows {
        let task_id = row.try_get("task_id")?;
        put_back_unstarted(transaction, task_id).await?;
        if row.try_get("ran")? {
            ran.push(task_id);
        }
    }
    Ok(ran)
}
