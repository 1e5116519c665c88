//! What retention does not keep: arrays of events that were learned, weights and anchors of versions; in small steps.
//!
//! Of an event its digest stays, so that copies are still known; of a version its lineage, evaluation and measures.

use jiff::Timestamp;
use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query};

use super::column::stored_time;
use super::{Purpose, Store, StoreError};

/// Later than any time.
const NEVER: &str = "9999";

impl Store {
    /// Drops the arrays of at most `limit` learned events of the model, the oldest first, of those that arrived before
    /// `before`. Events for tests stay: a reservoir may hold them. Tells of how many.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn prune_events(
        &self,
        model_id: i64,
        before: Option<Timestamp>,
        limit: u32,
        now: Timestamp,
    ) -> Result<u64, StoreError> {
        let before = before.map_or_else(|| NEVER.to_owned(), stored_time);
        let found = query(
            "select 1 from event indexed by event_prunable where model_id = ? and arrived_at < ? and state = 'learned'
                 and split <> 'test' and pruned_at is null limit 1",
        )
        .bind(model_id)
        .bind(&before)
        .fetch_optional(&self.readers)
        .await?;
        if found.is_none() {
            return Ok(0);
        }
        let mut transaction = self.begin().await?;
        transaction.is_for(Purpose::EventsPruned);
        let pruned = query(
            "update event set arrays = x'', pruned_at = ?1 where event_id in (
                 select event_id from event indexed by event_prunable where model_id = ?2 and arrived_at < ?3
                     and state = 'learned' and split <> 'test' and pruned_at is null order by arrived_at limit ?4)",
        )
        .bind(stored_time(now))
        .bind(model_id)
        .bind(before)
        .bind(limit)
        .execute(&mut *transaction)
        .await?;
        transaction.commit().await?;
        Ok(pruned.rows_affected())
    }

    /// Drops the weights of the oldest version of the model that is not among its `keep` newest, neither live nor the live
    /// one's parent, nor head, nor noted, and anchors that no other version holds on to; nothing while a replay is under
    /// way. Gives its number.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn prune_version(&self, model_id: i64, keep: u32, now: Timestamp) -> Result<Option<i64>, StoreError> {
        if superfluous(&mut *self.readers.acquire().await?, model_id, keep).await?.is_none() {
            return Ok(None);
        }
        let mut transaction = self.begin().await?;
        transaction.is_for(Purpose::VersionPruned);
        let Some(version) = superfluous(&mut transaction, model_id, keep).await? else { return Ok(None) };
        query("insert into pruned (model_id, version, pruned_at) values (?, ?, ?)")
            .bind(model_id)
            .bind(version)
            .bind(stored_time(now))
            .execute(&mut *transaction)
            .await?;
        query("delete from weights where model_id = ? and version = ?")
            .bind(model_id)
            .bind(version)
            .execute(&mut *transaction)
            .await?;
        query(
            "update anchor set importance = x'', weights = x'' where anchor_id in (
                 select r.anchor_id from version_regime r where r.model_id = ? and r.version = ?)
                 and not exists (
                     select 1 from version_regime o where o.anchor_id = anchor.anchor_id and o.anchor_id is not null
                         and not exists (select 1 from pruned p where p.model_id = o.model_id and p.version = o.version))",
        )
        .bind(model_id)
        .bind(version)
        .execute(&mut *transaction)
        .await?;
        transaction.commit().await?;
        Ok(Some(version))
    }
}

async fn superfluous(connection: &mut SqliteConnection, model_id: i64, keep: u32) -> Result<Option<i64>, StoreError> {
    let row = query(
        "select v.version from model m cross join version v on v.model_id = m.model_id
         where m.model_id = ?1
             and v.version <= (select max(n.version) from version n where n.model_id = ?1) - ?2
             and v.version is not m.live_version and v.version is not m.head_version
             and v.version is not (select l.parent from version l where l.model_id = ?1 and l.version = m.live_version)
             and not exists (select 1 from pruned p where p.model_id = ?1 and p.version = v.version)
             and not exists (select 1 from version_note n where n.model_id = ?1 and n.version = v.version)
             and not exists (select 1 from task t where t.model_id = ?1 and t.state in ('queued', 'running')
                             and t.kind = 'replay')
         order by v.version limit 1",
    )
    .bind(model_id)
    .bind(keep)
    .fetch_optional(connection)
    .await?;
    row.map(|row| Ok(row.try_get("version")?)).transpose()
}

/// Whether the version's weights were not kept.
pub(super) async fn is_pruned(
    connection: &mut SqliteConnection,
    model_id: i64,
    version: i64,
) -> Result<bool, StoreError> {
    let row = query("select exists (select 1 from pruned where model_id = ? and version = ?) as pruned")
        .bind(model_id)
        .bind(version)
        .fetch_one(connection)
        .await?;
    Ok(row.try_get("pruned")?)
}

/// Whether arrays of events that the task had, and that are not retracted, were not kept.
pub(super) async fn lost_events(connection: &mut SqliteConnection, task_id: i64) -> Result<bool, StoreError> {
    let row = query(
        "select exists (select 1 from task_event te cross join event e on e.event_id = te.event_id
             where te.task_id = ? and e.pruned_at is not null and e.state <> 'retracted') as lost",
    )
    .bind(task_id)
    .fetch_one(connection)
    .await?;
    Ok(row.try_get("lost")?)
}
