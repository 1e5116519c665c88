//! Sources: how the events of each fared lately, and which are held.

use jiff::Timestamp;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, query};

use super::column::{count, optional_time, stored_time};
use super::{Purpose, Store, StoreError, WriteTransaction};

/// A source of a model's events.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Row id.
    pub source_id: i64,
    /// As uploads name it.
    pub name: String,
    /// Of the checks of its last events, oldest first: `1` passed, `0` failed.
    pub outcomes: String,
    /// Since when it is held.
    pub held_at: Option<Timestamp>,
    /// Why it is, or was last.
    pub reason: Option<String>,
    /// When somebody released it last.
    pub released_at: Option<Timestamp>,
    /// Its events that wait because of that, or made training fail.
    pub held_events: u64,
}

/// `select` of every column, with what follows `from source`.
macro_rules! select_source {
    ($rest:literal) => {
        concat!(
            "select s.source_id, s.name, s.outcomes, s.held_at, s.reason, s.released_at, ",
            "(select count(*) from event e indexed by event_held where e.model_id = s.model_id and e.source = s.name ",
            "and e.state = 'held') as held_events from source s ",
            $rest
        )
    };
}

fn source_from(row: &SqliteRow) -> Result<Source, StoreError> {
    Ok(Source {
        source_id: row.try_get("source_id")?,
        name: row.try_get("name")?,
        outcomes: row.try_get("outcomes")?,
        held_at: optional_time(row, "held_at")?,
        reason: row.try_get("reason")?,
        released_at: optional_time(row, "released_at")?,
        held_events: count(row, "held_events")?,
    })
}

/// The source of this name, where it is known.
///
/// # Errors
/// When the database cannot be read.
pub async fn get(connection: &mut SqliteConnection, model_id: i64, name: &str) -> Result<Option<Source>, StoreError> {
    let row = query(select_source!("where s.model_id = ? and s.name = ?"))
        .bind(model_id)
        .bind(name)
        .fetch_optional(connection)
        .await?;
    row.as_ref().map(source_from).transpose()
}

/// Keeps how a source's last events fared.
///
/// # Errors
/// When the database cannot be written.
pub async fn note(
    transaction: &mut WriteTransaction,
    model_id: i64,
    name: &str,
    outcomes: &str,
) -> Result<(), StoreError> {
    query(
        "insert into source (model_id, name, outcomes) values (?, ?, ?)
         on conflict (model_id, name) do update set outcomes = excluded.outcomes",
    )
    .bind(model_id)
    .bind(name)
    .bind(outcomes)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// Holds a source, with those of its events that wait for a task.
///
/// # Errors
/// When the database cannot be written.
pub async fn hold(
    transaction: &mut WriteTransaction,
    model_id: i64,
    name: &str,
    reason: &str,
    now: Timestamp,
) -> Result<(), StoreError> {
    query("update source set held_at = ?, reason = ? where model_id = ? and name = ?")
        .bind(stored_time(now))
        .bind(reason)
        .bind(model_id)
        .bind(name)
        .execute(&mut **transaction)
        .await?;
    query("update event set state = 'held' where model_id = ? and state = 'pending' and source = ?")
        .bind(model_id)
        .bind(name)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

/// Releases a source: its events wait for a task again, but for those that made one fail, and what it sends is judged anew.
/// Tells how many wait; none when no source of this name is held.
///
/// # Errors
/// When the database cannot be written.
pub async fn release(
    transaction: &mut WriteTransaction,
    model_id: i64,
    name: &str,
    now: Timestamp,
) -> Result<Option<u64>, StoreError> {
    transaction.is_for(Purpose::SourceReleased);
    let released = query(
        "update source set held_at = null, released_at = ?, outcomes = ''
         where model_id = ? and name = ? and held_at is not null",
    )
    .bind(stored_time(now))
    .bind(model_id)
    .bind(name)
    .execute(&mut **transaction)
    .await?;
    if released.rows_affected() == 0 {
        return Ok(None);
    }
    let waiting = query(
        "update event set state = 'pending' where model_id = ? and state = 'held' and source = ?
             and not exists (select 1 from task_event te where te.event_id = event.event_id)",
    )
    .bind(model_id)
    .bind(name)
    .execute(&mut **transaction)
    .await?;
    Ok(Some(waiting.rows_affected()))
}

impl Store {
    /// Up to `limit` sources of the model with row ids above `after`, in the order first seen.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn sources(&self, model_id: i64, after: i64, limit: u32) -> Result<Vec<Source>, StoreError> {
        let rows = query(select_source!("where s.model_id = ? and s.source_id > ? order by s.source_id limit ?"))
            .bind(model_id)
            .bind(after)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(source_from).collect()
    }
}
