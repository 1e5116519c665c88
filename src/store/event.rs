//! Events: each content once a model, however often it is uploaded.

use jiff::Timestamp;
use sqlx::{QueryBuilder, Row, Sqlite, query};

use super::column::stored_time;
use super::{StoreError, WriteTransaction};
use crate::car_following::Event;
use crate::lineage::{RegimeName, Split};

/// Links written with one statement.
pub const LINKS_AT_ONCE: usize = 500;

/// An event that arrives.
#[derive(Debug, Clone, PartialEq)]
pub struct NewEvent {
    /// The client's id.
    pub name: String,
    /// Where it was recorded.
    pub source: Option<String>,
    /// Of which recording it is a part.
    pub run: Option<String>,
    /// Its side.
    pub split: Split,
    /// Its regime.
    pub regime: RegimeName,
    /// Digest of its content.
    pub content_sha256: [u8; 32],
    /// Its content.
    pub event: Event,
}

/// Where an event of a batch is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Link {
    /// Row id of the event.
    pub event_id: i64,
    /// Whether the model had its content already.
    pub duplicate: bool,
}

/// Stores an event that arrives in `batch_id`, unless the model has its content. Content that was retracted waits
/// again, in this batch and under this batch's regime; of everything else the first copy decides.
///
/// # Errors
/// When the database cannot be written.
pub async fn store(
    transaction: &mut WriteTransaction,
    model_id: i64,
    batch_id: i64,
    arriving: &NewEvent,
    now: Timestamp,
) -> Result<Link, StoreError> {
    let event = &arriving.event;
    let steps = i64::try_from(event.steps()).map_err(|e| StoreError::malformed("number of steps", e))?;
    // A conflict with content that still counts updates nothing, and then no row comes back.
    let row = query(
        "insert into event (model_id, content_sha256, batch_id, name, source, run, split, regime, state, dt_s, steps,
             mean_speed_mps, arrived_at, arrays) values (?, ?, ?, ?, ?, ?, ?, ?, 'pending', ?, ?, ?, ?, ?)
         on conflict (model_id, content_sha256) do update set state = 'pending', batch_id = excluded.batch_id,
             regime = excluded.regime, arrived_at = excluded.arrived_at where state = 'retracted'
         returning event_id",
    )
    .bind(model_id)
    .bind(&arriving.content_sha256[..])
    .bind(batch_id)
    .bind(&arriving.name)
    .bind(arriving.source.as_deref())
    .bind(arriving.run.as_deref())
    .bind(arriving.split.as_str())
    .bind(arriving.regime.as_str())
    .bind(event.dt_s())
    .bind(steps)
    .bind(event.mean_speed_mps())
    .bind(stored_time(now))
    .bind(event.to_bytes())
    .fetch_optional(&mut **transaction)
    .await?;
    if let Some(row) = row {
        return Ok(Link { event_id: row.try_get("event_id")?, duplicate: false });
    }
    let known = query("select event_id from event where model_id = ? and content_sha256 = ?")
        .bind(model_id)
        .bind(&arriving.content_sha256[..])
        .fetch_one(&mut **transaction)
        .await?;
    Ok(Link { event_id: known.try_get("event_id")?, duplicate: true })
}

/// Notes that a batch holds these events, the first of them at `ordinal`, in order: at most [`LINKS_AT_ONCE`].
///
/// # Errors
/// When the database cannot be written.
pub async fn link(
    transaction: &mut WriteTransaction,
    batch_id: i64,
    ordinal: i64,
    links: &[Link],
) -> Result<(), StoreError> {
    if links.is_empty() {
        return Ok(());
    }
    let mut insert = QueryBuilder::<Sqlite>::new("insert into batch_event (batch_id, ordinal, event_id, duplicate) ");
    insert.push_values(links.iter().zip(ordinal..), |mut row, (link, ordinal)| {
        row.push_bind(batch_id).push_bind(ordinal).push_bind(link.event_id).push_bind(link.duplicate);
    });
    // Batches differ in length: kept statements of every length would push the others out.
    insert.build().persistent(links.len() == LINKS_AT_ONCE).execute(&mut **transaction).await?;
    Ok(())
}
