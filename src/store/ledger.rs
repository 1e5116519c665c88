//! The events behind a task, a line and a test reservoir. What was retracted since is nowhere among those of a line or a
//! reservoir, as somebody may have insisted on a version that learned it, nor is what retention did not keep.

use futures_util::{Stream, StreamExt, TryStreamExt};
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, query};

use super::array::integers;
use super::column::{digest, stored_ids};
use super::line::with_line;
use super::version::ROLL_BACK;
use super::{Part, Store, StoreError, seal};
use crate::car_following::Event;
use crate::lineage::{RegimeName, Split};

/// A stored event and its content digest.
#[derive(Debug, Clone, PartialEq)]
pub struct LedgerEvent {
    /// Its row id.
    pub event_id: i64,
    /// Digest of its content as uploaded.
    pub sha256: [u8; 32],
    /// The event, at the step it was uploaded with.
    pub event: Event,
}

fn event_from(row: &SqliteRow) -> Result<LedgerEvent, StoreError> {
    let (event_id, dt_s, arrays) = (row.try_get("event_id")?, row.try_get("dt_s")?, row.try_get("arrays")?);
    let sha256 = digest(row, "content_sha256")?;
    let event = Event::from_bytes(dt_s, arrays).filter(|_| Event::digest_of(dt_s, arrays) == sha256);
    let Some(event) = event else { return Err(corrupt(row)?) };
    Ok(LedgerEvent { event_id, sha256, event })
}

/// Names an event whose arrays are not what was uploaded.
pub(super) fn corrupt(row: &SqliteRow) -> Result<StoreError, StoreError> {
    let (name, batch_id): (&str, i64) = (row.try_get("name")?, row.try_get("batch_id")?);
    let detail = format!(
        "event {name} of batch b{batch_id} is corrupt: its digest does not match; an upload of the same content mends it"
    );
    Ok(StoreError::corrupt(Part::Event, detail))
}

/// Row by row: all rows and all events at once would be twice the memory.
async fn events_from(rows: impl Stream<Item = Result<SqliteRow, sqlx::Error>>) -> Result<Vec<LedgerEvent>, StoreError> {
    rows.map(|row| event_from(&row?)).try_collect().await
}

impl Store {
    /// The training events of a task's ledger, in order of their digests.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn training_events(&self, task_id: i64) -> Result<Vec<LedgerEvent>, StoreError> {
        let rows = query(
            "select e.* from task_event te join event e using (event_id)
             where te.task_id = ? and e.split = 'train' order by e.content_sha256",
        )
        .bind(task_id)
        .fetch(&self.readers);
        events_from(rows).await
    }

    /// The `limit` validation events of least digest of a task's ledger, in order of their digests.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn validation_events(&self, task_id: i64, limit: u32) -> Result<Vec<LedgerEvent>, StoreError> {
        let rows = query(
            "select e.* from task_event te join event e using (event_id)
             where te.task_id = ? and e.split = 'validation' order by e.content_sha256 limit ?",
        )
        .bind(task_id)
        .bind(limit)
        .fetch(&self.readers);
        events_from(rows).await
    }

    /// The training events of a task's ledger and of the tasks behind `parent` and its parents, each once, in order of
    /// their digests: what `joint` learns.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn line_training_events(
        &self,
        model_id: i64,
        task_id: i64,
        parent: i64,
    ) -> Result<Vec<LedgerEvent>, StoreError> {
        let rows = query(with_line!(
            "?2",
            "select e.* from event e
             where e.split = 'train' and e.state <> 'retracted' and e.pruned_at is null and e.event_id in (
                 select event_id from task_event where task_id = ?3
                 union
                 select te.event_id from line cross join task_event te on te.task_id = line.task_id
             )
             order by e.content_sha256"
        ))
        .bind(model_id)
        .bind(parent)
        .bind(task_id)
        .fetch(&self.readers);
        events_from(rows).await
    }

    /// For each regime that the tasks behind `parent` and its parents learned, in order of their names: the `limit` events
    /// of this side of least digest among those of the tasks, without the task's own, in order of their digests. Those for
    /// training are what methods that replay learn beside the new events, those for validation what a search for a strength
    /// drives beside the task's own.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn line_events_by_regime(
        &self,
        split: Split,
        model_id: i64,
        task_id: i64,
        parent: i64,
        limit: u32,
    ) -> Result<Vec<(String, Vec<LedgerEvent>)>, StoreError> {
        let mut rows = query(with_line!(
            "?2",
            ", learned as (
                 select distinct line.regime, e.event_id, e.content_sha256
                 from line cross join task_event te using (task_id) join event e using (event_id)
                 where e.split = ?5 and e.state <> 'retracted' and e.pruned_at is null
                     and e.event_id not in (select event_id from task_event where task_id = ?3)
             ),
             ranked as (
                 select *, row_number() over (partition by regime order by content_sha256) as place from learned
             )
             select r.regime as learned_as, e.*
             from ranked r join event e using (event_id)
             where r.place <= ?4 order by r.regime, e.content_sha256"
        ))
        .bind(model_id)
        .bind(parent)
        .bind(task_id)
        .bind(limit)
        .bind(split.as_str())
        .fetch(&self.readers);
        let mut regimes: Vec<(String, Vec<LedgerEvent>)> = Vec::new();
        while let Some(row) = rows.try_next().await? {
            let (regime, event) = (row.try_get("learned_as")?, event_from(&row)?);
            match regimes.last_mut() {
                Some((last, events)) if *last == regime => events.push(event),
                _ => regimes.push((regime, vec![event])),
            }
        }
        Ok(regimes)
    }

    /// The `limit` training events of least digest that the version's line learned, under one regime or under any, in order
    /// of their digests.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn line_sample(
        &self,
        model_id: i64,
        version: i64,
        regime: Option<&RegimeName>,
        limit: u32,
    ) -> Result<Vec<LedgerEvent>, StoreError> {
        let rows = query(with_line!(
            "?2",
            "select e.* from event e
             where e.split = 'train' and e.state <> 'retracted' and e.pruned_at is null and e.event_id in (
                 select te.event_id from line cross join task t on t.task_id = line.task_id
                 cross join task_event te on te.task_id = t.task_id
                 where ?3 is null or t.regime = ?3
             )
             order by e.content_sha256 limit ?4"
        ))
        .bind(model_id)
        .bind(version)
        .bind(regime.map(RegimeName::as_str))
        .bind(limit)
        .fetch(&self.readers);
        events_from(rows).await
    }

    /// The test events of a reservoir, if there is one yet, after a task: the `limit` of least digest among the old ones
    /// and the task's, in order of their digests.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn refreshed_reservoir(
        &self,
        old: Option<i64>,
        task_id: i64,
        limit: u32,
    ) -> Result<Vec<LedgerEvent>, StoreError> {
        let old = match old {
            Some(reservoir_id) => self.reservoir_ids(reservoir_id).await?,
            None => Vec::new(),
        };
        let rows = query(
            "select * from event
             where event_id in (
                 select value from json_each(?)
                 union
                 select te.event_id from task_event te join event e using (event_id)
                 where te.task_id = ? and e.split = 'test'
             ) and state <> 'retracted'
             order by content_sha256 limit ?",
        )
        .bind(stored_ids(&old))
        .bind(task_id)
        .bind(limit)
        .fetch(&self.readers);
        events_from(rows).await
    }

    /// The test events of a reservoir, in order of their digests.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn reservoir(&self, reservoir_id: i64) -> Result<Vec<LedgerEvent>, StoreError> {
        let ids = self.reservoir_ids(reservoir_id).await?;
        let rows = query(
            "select * from event
             where event_id in (select value from json_each(?)) and state <> 'retracted' order by content_sha256",
        )
        .bind(stored_ids(&ids))
        .fetch(&self.readers);
        events_from(rows).await
    }

    async fn reservoir_ids(&self, reservoir_id: i64) -> Result<Vec<i64>, StoreError> {
        let row =
            query("select * from reservoir where reservoir_id = ?").bind(reservoir_id).fetch_one(&self.readers).await?;
        if !seal::RESERVOIR.is_intact(&row)? {
            let detail = format!("test reservoir {reservoir_id} is corrupt: its digest does not match; {ROLL_BACK}");
            return Err(StoreError::corrupt(Part::Reservoir, detail));
        }
        integers("reservoir", row.try_get("event_ids")?)
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::Fixture;
    use crate::consolidation::Method;
    use crate::lineage::ModelSettings;

    #[tokio::test]
    async fn validation_events_are_the_tasks_own_of_least_digest() {
        let fixture = Fixture::new().await;
        let model_id = fixture.model("m", Method::Ewc, &ModelSettings::default()).await;
        fixture.batch(model_id, "fast", 0..40).await;
        fixture.batch(model_id, "slow", 40..60).await;
        let tasks = fixture.tasks_of_pending(model_id).await;
        let digests = async |task, limit| {
            let events = fixture.store.validation_events(task, limit).await.unwrap();
            events.into_iter().map(|stored| stored.sha256).collect::<Vec<_>>()
        };
        let all = digests(tasks[0], 100).await;
        assert!(all.len() == 4 && all.is_sorted());
        assert_eq!(digests(tasks[0], 3).await, all[..3]);
        assert_eq!(digests(tasks[1], 100).await.len(), 2);
    }
}
