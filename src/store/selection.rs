//! From waiting events to tasks: which events a request selects, and their claim.

use jiff::Timestamp;
use serde_json::Value;
use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query};

use super::column::{count, stored_ids, stored_time, time, word};
use super::{Purpose, Store, StoreError, WriteTransaction};
use crate::lineage::{RegimeName, Schedule};

/// Which events are to be learned.
#[derive(Debug, Clone, PartialEq)]
pub enum Selection {
    /// Those that wait, of one regime or of all.
    Pending {
        /// Only these; all where none.
        regime: Option<RegimeName>,
    },
    /// Those of these batches, also the ones that were set aside, held or learned before; neither those of a source that is
    /// held nor those whose arrays were not kept.
    Batches {
        /// Batch ids.
        batches: Vec<i64>,
        /// The name they are learned under; each event's own where none.
        regime: Option<RegimeName>,
    },
}

/// A wish for tasks.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskRequest {
    /// Which events.
    pub selection: Selection,
    /// Of these, only events whose mean follower speed lies in [low, high], m/s.
    pub mean_speed_mps: Option<[f64; 2]>,
    /// Overrides of the model's settings, checked: an object or null.
    pub settings: Value,
}

/// Why a request makes no task.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoTask {
    /// The selection is empty.
    #[error("no event that is selected waits to be learned")]
    NothingPending,
    /// The model has no such batch.
    #[error("the model has no batch {0}")]
    UnknownBatch(i64),
    /// The batch was retracted.
    #[error("batch {0} was retracted")]
    RetractedBatch(i64),
}

impl Store {
    /// Row ids of the models some of whose events wait.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn models_waiting(&self) -> Result<Vec<i64>, StoreError> {
        // Left to itself, the planner looks for one that waits among all events of the model.
        let rows = query(
            "select model_id from model m where exists (
                 select 1 from event e indexed by event_waiting where e.model_id = m.model_id and e.state = 'pending'
             ) order by model_id",
        )
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(|row| Ok(row.try_get("model_id")?)).collect()
    }

    /// Whether some regime's waiting events are due by `schedule`.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn is_any_due(&self, model_id: i64, schedule: Schedule, now: Timestamp) -> Result<bool, StoreError> {
        let mut reader = self.readers.acquire().await?;
        Ok(!due(&mut reader, model_id, schedule, now).await?.is_empty())
    }
}

/// The regimes whose waiting events are due by `schedule`, in order of arrival.
///
/// It looks at the first event of each regime and counts up to the schedule's number, however many wait.
async fn due(
    connection: &mut SqliteConnection,
    model_id: i64,
    schedule: Schedule,
    now: Timestamp,
) -> Result<Vec<RegimeName>, StoreError> {
    let Schedule::Automatic(automatic) = schedule else { return Ok(Vec::new()) };
    let rows = query(
        "with recursive waiting (regime) as (
             select min(regime) from event where model_id = ?1 and state = 'pending'
             union all
             select (select min(e.regime) from event e
                     where e.model_id = ?1 and e.state = 'pending' and e.regime > waiting.regime)
             from waiting where waiting.regime is not null
         )
         select waiting.regime, first.arrived_at as oldest,
             (select count(*) from (select 1 from event e
                  where e.model_id = ?1 and e.state = 'pending' and e.regime = waiting.regime limit ?2)) as events
         from waiting join event first on first.event_id = (
             select e.event_id from event e where e.model_id = ?1 and e.state = 'pending' and e.regime = waiting.regime
             order by e.arrived_at, e.event_id limit 1
         )
         order by first.arrived_at, first.event_id",
    )
    .bind(model_id)
    .bind(automatic.min_events.max(1))
    .fetch_all(connection)
    .await?;
    let mut due = Vec::new();
    for row in &rows {
        let (events, oldest) = (count(row, "events")?, time(row, "oldest")?);
        if schedule.is_due(events, now.duration_since(oldest).as_secs_f64()) {
            due.push(word(row, "regime")?);
        }
    }
    Ok(due)
}

/// Makes the tasks a request asks for, one a regime in order of arrival, and claims their events. Gives their ids.
///
/// # Errors
/// When the database cannot be written.
pub async fn create_tasks(
    transaction: &mut WriteTransaction,
    model_id: i64,
    request: &TaskRequest,
    now: Timestamp,
) -> Result<Result<Vec<i64>, NoTask>, StoreError> {
    transaction.is_for(Purpose::TaskCreated);
    let named = match &request.selection {
        Selection::Pending { .. } => None,
        Selection::Batches { batches, .. } => {
            if let Some(refusal) = refused_batch(transaction, model_id, batches).await? {
                return Ok(Err(refusal));
            }
            Some(stored_ids(batches))
        }
    };
    let mut tasks = Vec::new();
    for (learned_as, events_of) in groups(transaction, model_id, request, named.as_deref()).await? {
        let task_id = insert_task(transaction, model_id, &learned_as, &request.settings, now).await?;
        claim(transaction, model_id, task_id, request, named.as_deref(), events_of.as_ref()).await?;
        tasks.push(task_id);
    }
    Ok(if tasks.is_empty() { Err(NoTask::NothingPending) } else { Ok(tasks) })
}

/// Makes a task of every regime whose waiting events are due by the model's schedule. Gives their ids.
///
/// # Errors
/// When the database cannot be written.
pub async fn create_due(
    transaction: &mut WriteTransaction,
    model_id: i64,
    schedule: Schedule,
    now: Timestamp,
) -> Result<Vec<i64>, StoreError> {
    transaction.is_for(Purpose::TaskCreated);
    let mut tasks = Vec::new();
    for regime in due(transaction, model_id, schedule, now).await? {
        let request = TaskRequest {
            selection: Selection::Pending { regime: Some(regime) },
            mean_speed_mps: None,
            settings: Value::Null,
        };
        tasks.extend(create_tasks(transaction, model_id, &request, now).await?.unwrap_or_default());
    }
    Ok(tasks)
}

async fn refused_batch(
    transaction: &mut WriteTransaction,
    model_id: i64,
    batches: &[i64],
) -> Result<Option<NoTask>, StoreError> {
    let row = query(
        "select named.value as batch_id, b.batch_id is null as unknown from json_each(?) named
         left join batch b on b.batch_id = named.value and b.model_id = ?
         where b.batch_id is null or b.retracted_at is not null order by named.key limit 1",
    )
    .bind(stored_ids(batches))
    .bind(model_id)
    .fetch_optional(&mut **transaction)
    .await?;
    let Some(row) = row else { return Ok(None) };
    let batch_id = row.try_get("batch_id")?;
    let unknown: i64 = row.try_get("unknown")?;
    Ok(Some(if unknown == 1 { NoTask::UnknownBatch(batch_id) } else { NoTask::RetractedBatch(batch_id) }))
}

/// The tasks to make: the regime each is learned as, and the regime its events must have (none: whatever).
async fn groups(
    transaction: &mut WriteTransaction,
    model_id: i64,
    request: &TaskRequest,
    named: Option<&str>,
) -> Result<Vec<(RegimeName, Option<RegimeName>)>, StoreError> {
    let [low, high] = bounds(request);
    let (regime, rows) = match &request.selection {
        Selection::Pending { regime } => {
            let rows = query(
                "select regime, min(event_id) as first from event
                 where model_id = ? and state = 'pending' and mean_speed_mps between ? and ?
                 group by regime order by first",
            )
            .bind(model_id)
            .bind(low)
            .bind(high)
            .fetch_all(&mut **transaction)
            .await?;
            (regime, rows)
        }
        Selection::Batches { regime, .. } => {
            let rows = query(
                "select e.regime, min(e.event_id) as first from json_each(?) named
                 join batch_event be on be.batch_id = named.value join event e on e.event_id = be.event_id
                 where e.state in ('pending', 'set_aside', 'held', 'learned') and e.mean_speed_mps between ? and ?
                     and e.pruned_at is null and not (e.state = 'held' and exists (select 1 from source s
                         where s.model_id = e.model_id and s.name = e.source and s.held_at is not null))
                 group by e.regime order by first",
            )
            .bind(named)
            .bind(low)
            .bind(high)
            .fetch_all(&mut **transaction)
            .await?;
            (regime, rows)
        }
    };
    let found = rows.iter().map(|row| word(row, "regime")).collect::<Result<Vec<RegimeName>, _>>()?;
    Ok(match (regime, named) {
        (None, _) => found.into_iter().map(|regime| (regime.clone(), Some(regime))).collect(),
        (Some(regime), None) => {
            found.into_iter().filter(|one| one == regime).map(|one| (one.clone(), Some(one))).collect()
        }
        (Some(_), Some(_)) if found.is_empty() => Vec::new(),
        (Some(regime), Some(_)) => vec![(regime.clone(), None)],
    })
}

/// The range of mean speeds; all of them where the request names none.
fn bounds(request: &TaskRequest) -> [f64; 2] {
    request.mean_speed_mps.unwrap_or([f64::MIN, f64::MAX])
}

async fn insert_task(
    transaction: &mut WriteTransaction,
    model_id: i64,
    regime: &RegimeName,
    settings: &Value,
    now: Timestamp,
) -> Result<i64, StoreError> {
    let row = query(
        "insert into task (model_id, state, regime, settings, created_at) values (?, 'queued', ?, ?, ?)
         returning task_id",
    )
    .bind(model_id)
    .bind(regime.as_str())
    .bind(settings.to_string())
    .bind(stored_time(now))
    .fetch_one(&mut **transaction)
    .await?;
    Ok(row.try_get("task_id")?)
}

/// Writes the ledger of a task, the batches it comes from, and claims its events.
async fn claim(
    transaction: &mut WriteTransaction,
    model_id: i64,
    task_id: i64,
    request: &TaskRequest,
    named: Option<&str>,
    events_of: Option<&RegimeName>,
) -> Result<(), StoreError> {
    let [low, high] = bounds(request);
    let (ledger, sources) = if named.is_some() { CLAIM_NAMED } else { CLAIM_PENDING };
    query(ledger)
        .bind(task_id)
        .bind(model_id)
        .bind(events_of.map(RegimeName::as_str))
        .bind(low)
        .bind(high)
        .bind(named)
        .execute(&mut **transaction)
        .await?;
    query(sources).bind(task_id).bind(named).execute(&mut **transaction).await?;
    query("update event set state = 'claimed' where event_id in (select event_id from task_event where task_id = ?)")
        .bind(task_id)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

const CLAIM_PENDING: (&str, &str) = (
    "insert into task_event (task_id, event_id)
     select ?1, event_id from event
     where model_id = ?2 and state = 'pending' and regime = ?3 and mean_speed_mps between ?4 and ?5 and ?6 is null",
    "insert into task_batch (task_id, batch_id)
     select distinct ?1, e.batch_id from task_event te join event e on e.event_id = te.event_id
     where te.task_id = ?1 and ?2 is null",
);

const CLAIM_NAMED: (&str, &str) = (
    "insert into task_event (task_id, event_id)
     select distinct ?1, e.event_id from json_each(?6) named
     join batch_event be on be.batch_id = named.value join event e on e.event_id = be.event_id
     where e.model_id = ?2 and (?3 is null or e.regime = ?3) and e.mean_speed_mps between ?4 and ?5
         and e.state in ('pending', 'set_aside', 'held', 'learned') and e.pruned_at is null
         and not (e.state = 'held' and exists (select 1 from source s
                  where s.model_id = e.model_id and s.name = e.source and s.held_at is not null))",
    "insert into task_batch (task_id, batch_id)
     select distinct ?1, be.batch_id from json_each(?2) named
     join batch_event be on be.batch_id = named.value
     join task_event te on te.event_id = be.event_id and te.task_id = ?1",
);

#[cfg(test)]
#[path = "selection_tests.rs"]
mod tests;
