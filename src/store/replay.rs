//! A replay: the tasks that learn stages of a line again, and the one that ends them.

use jiff::Timestamp;
use sqlx::{Row, query};

use super::column::{stored_time, word};
use super::history::{self, Action, Change};
use super::line::with_line;
use super::outcome::Overtaken;
use super::pointers::{self, Pointers};
use super::{Purpose, Store, StoreError, WriteTransaction};
use crate::lineage::{RegimeName, ReplayReport, ReplayedStage};

/// A version of the head's line.
pub(super) struct LineStage {
    pub(super) version: i64,
    pub(super) parent: Option<i64>,
    pub(super) task_id: Option<i64>,
}

/// A replay to be made.
pub(super) struct NewReplay<'a> {
    pub(super) model_id: i64,
    /// What was retracted.
    pub(super) batch_id: i64,
    /// The first that is learned again.
    pub(super) regime: &'a RegimeName,
    /// The head before.
    pub(super) from_head: Option<i64>,
    /// What is learned again, in order.
    pub(super) stages: &'a [LineStage],
}

/// What a replay has to measure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Replay {
    /// The head before.
    pub from_head: Option<i64>,
    /// Versions whose stage was to be learned again, and what replaced them, in order.
    pub stages: Vec<ReplayedStage>,
}

/// Makes a replay and its parts, which claim the events of the stages that are left. Gives its id.
pub(super) async fn create(
    transaction: &mut WriteTransaction,
    wish: &NewReplay<'_>,
    now: Timestamp,
) -> Result<i64, StoreError> {
    let row = query(
        "insert into task (model_id, kind, state, regime, settings, parent_version, place, created_at)
         select model_id, 'replay', 'queued', ?, 'null', head_version, 0, ? from model where model_id = ?
         returning task_id",
    )
    .bind(wish.regime.as_str())
    .bind(stored_time(now))
    .bind(wish.model_id)
    .fetch_one(&mut **transaction)
    .await?;
    let task_id = row.try_get("task_id")?;
    query("insert into replay (task_id, batch_id, from_head) values (?, ?, ?)")
        .bind(task_id)
        .bind(wish.batch_id)
        .bind(wish.from_head)
        .execute(&mut **transaction)
        .await?;
    query("insert into task_batch (task_id, batch_id) values (?, ?)")
        .bind(task_id)
        .bind(wish.batch_id)
        .execute(&mut **transaction)
        .await?;
    // Before what is left of an earlier replay: its parts come later on the line.
    let row = query(
        "select min(0, coalesce(min(place), 0)) as first from task
         where model_id = ? and state in ('queued', 'running')",
    )
    .bind(wish.model_id)
    .fetch_one(&mut **transaction)
    .await?;
    let first = row.try_get::<i64, _>("first")? - i64::try_from(wish.stages.len()).unwrap_or(i64::MAX);
    for (place, stage) in (first..).zip(wish.stages) {
        create_part(transaction, task_id, place, stage, now).await?;
    }
    Ok(task_id)
}

/// A stage's task once more, without the events that are retracted; none where nothing is left for training.
async fn create_part(
    transaction: &mut WriteTransaction,
    replay_id: i64,
    place: i64,
    stage: &LineStage,
    now: Timestamp,
) -> Result<(), StoreError> {
    let row = query(
        "insert into task (model_id, state, regime, settings, replay_id, replays, place, created_at)
         select model_id, 'queued', regime, settings, ?, ?, ?, ? from task t where t.task_id = ? and exists (
             select 1 from task_event te cross join event e on e.event_id = te.event_id
             where te.task_id = t.task_id and e.split = 'train' and e.state <> 'retracted')
         returning task_id",
    )
    .bind(replay_id)
    .bind(stage.version)
    .bind(place)
    .bind(stored_time(now))
    .bind(stage.task_id)
    .fetch_optional(&mut **transaction)
    .await?;
    let Some(row) = row else { return Ok(()) };
    let task_id: i64 = row.try_get("task_id")?;
    query(
        "insert into task_event (task_id, event_id)
         select ?, te.event_id from task_event te cross join event e on e.event_id = te.event_id
         where te.task_id = ? and e.state <> 'retracted'",
    )
    .bind(task_id)
    .bind(stage.task_id)
    .execute(&mut **transaction)
    .await?;
    note_batches(transaction, task_id).await?;
    query("update event set state = 'claimed' where event_id in (select event_id from task_event where task_id = ?)")
        .bind(task_id)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

/// Notes the batches that a task's events come from, beside those it has.
pub(super) async fn note_batches(transaction: &mut WriteTransaction, task_id: i64) -> Result<(), StoreError> {
    query(
        "insert or ignore into task_batch (task_id, batch_id)
         select distinct ?1, e.batch_id from task_event te cross join event e on e.event_id = te.event_id
         where te.task_id = ?1",
    )
    .bind(task_id)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// Whether some event of the task is for training.
pub(super) async fn can_train(transaction: &mut WriteTransaction, task_id: i64) -> Result<bool, StoreError> {
    let row = query(
        "select exists (select 1 from task_event te cross join event e on e.event_id = te.event_id
             where te.task_id = ? and e.split = 'train') as can",
    )
    .bind(task_id)
    .fetch_one(&mut **transaction)
    .await?;
    Ok(row.try_get("can")?)
}

/// The replay of a batch that waits or runs.
pub(super) async fn under_way(transaction: &mut WriteTransaction, batch_id: i64) -> Result<Option<i64>, StoreError> {
    let row = query(
        "select t.task_id from replay r cross join task t on t.task_id = r.task_id
         where r.batch_id = ? and t.state in ('queued', 'running')",
    )
    .bind(batch_id)
    .fetch_optional(&mut **transaction)
    .await?;
    row.map(|row| Ok(row.try_get("task_id")?)).transpose()
}

impl Store {
    /// What a replay has to measure.
    ///
    /// # Errors
    /// When the database cannot be read, or the task is no replay.
    pub async fn replay(&self, model_id: i64, task_id: i64) -> Result<Replay, StoreError> {
        let row =
            query("select from_head from replay where task_id = ?").bind(task_id).fetch_one(&self.readers).await?;
        let from_head = row.try_get("from_head")?;
        let rows = query(with_line!(
            "?2",
            "select line.version, line.regime, p.version as replayed_as from line
             left join task p on p.replay_id = ?3 and p.replays = line.version
             where line.version > coalesce((select parent_version from task where task_id = ?3), 0)"
        ))
        .bind(model_id)
        .bind(from_head)
        .bind(task_id)
        .fetch_all(&self.readers)
        .await?;
        let stages = rows.iter().rev().map(|row| {
            Ok(ReplayedStage {
                version: row.try_get("version")?,
                regime: word(row, "regime")?,
                replayed_as: row.try_get("replayed_as")?,
            })
        });
        Ok(Replay { from_head, stages: stages.collect::<Result<_, StoreError>>()? })
    }
}

/// Ends a replay with its report, and moves live where the report says so.
///
/// # Errors
/// When the database cannot be written.
pub async fn ended(
    transaction: &mut WriteTransaction,
    task_id: i64,
    report: &ReplayReport,
    now: Timestamp,
) -> Result<Result<(), Overtaken>, StoreError> {
    transaction.is_for(Purpose::ReplayEnded);
    let task = query("select model_id, state, cancel_requested from task where task_id = ?")
        .bind(task_id)
        .fetch_one(&mut **transaction)
        .await?;
    let model_id: i64 = task.try_get("model_id")?;
    if task.try_get::<&str, _>("state")? != "running" {
        return Ok(Err(Overtaken::Ended));
    }
    if task.try_get::<i64, _>("cancel_requested")? == 1 {
        return Ok(Err(Overtaken::CancelRequested));
    }
    let found = pointers::read(transaction, model_id).await?;
    if (found.live, found.head) != (report.live.from, report.after) {
        return Ok(Err(Overtaken::LiveMoved));
    }
    let before = Pointers { head: report.before, ..found };
    let after = Pointers { live: report.live.to, ..found };
    if after != found {
        pointers::write(transaction, model_id, &after).await?;
    }
    let change = Change {
        model_id,
        action: Action::Replay,
        before: &before,
        after: &after,
        reason: &report.live.reason,
        report: Some(report),
    };
    history::write(transaction, &change, now).await?;
    query("update replay set report = ? where task_id = ?")
        .bind(serde_json::to_string(report).expect("a report is plain data"))
        .bind(task_id)
        .execute(&mut **transaction)
        .await?;
    query("update task set state = 'succeeded', version = ?, ended_at = ? where task_id = ?")
        .bind(report.after)
        .bind(stored_time(now))
        .bind(task_id)
        .execute(&mut **transaction)
        .await?;
    Ok(Ok(()))
}
