//! Batches: an upload's row, and what became of its events.

use jiff::Timestamp;
use serde_json::Value;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, query};

use super::column::{count, json, optional_time, stored_time, time, word};
use super::{Purpose, Store, StoreError, WriteTransaction};
use crate::lineage::{Batch, EventCounts, RegimeName};

/// An upload that begins to be stored.
#[derive(Debug, Clone, PartialEq)]
pub struct NewBatch {
    /// The model's row id.
    pub model_id: i64,
    /// As the upload named it.
    pub source: Option<String>,
    /// The upload's label.
    pub regime: Option<RegimeName>,
    /// Media type of the body.
    pub content_type: String,
    /// Digest of the body as it was sent.
    pub body_sha256: [u8; 32],
    /// Length of the body as it was sent.
    pub body_bytes: u64,
    /// When it is stored.
    pub created_at: Timestamp,
}

/// What an upload came to.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchOutcome {
    /// Events stored, or brought back.
    pub accepted: u64,
    /// Events known before.
    pub duplicates: u64,
    /// Events refused.
    pub rejected: u64,
    /// JSON.
    pub summary: Value,
}

/// Begins a batch and gives its id; [`end`] is due in the same transaction.
///
/// # Errors
/// When the database cannot be written.
pub async fn begin(transaction: &mut WriteTransaction, batch: &NewBatch) -> Result<i64, StoreError> {
    transaction.is_for(Purpose::BatchUploaded);
    let row = query(
        "insert into batch (model_id, source, regime, content_type, body_sha256, body_bytes, accepted, duplicates,
             rejected, summary, created_at) values (?, ?, ?, ?, ?, ?, 0, 0, 0, '{}', ?) returning batch_id",
    )
    .bind(batch.model_id)
    .bind(batch.source.as_deref())
    .bind(batch.regime.as_ref().map(RegimeName::as_str))
    .bind(&batch.content_type)
    .bind(&batch.body_sha256[..])
    .bind(number(batch.body_bytes)?)
    .bind(stored_time(batch.created_at))
    .fetch_one(&mut **transaction)
    .await?;
    Ok(row.try_get("batch_id")?)
}

/// Writes what the upload came to.
///
/// # Errors
/// When the database cannot be written.
pub async fn end(transaction: &mut WriteTransaction, batch_id: i64, outcome: &BatchOutcome) -> Result<(), StoreError> {
    query("update batch set accepted = ?, duplicates = ?, rejected = ?, summary = ? where batch_id = ?")
        .bind(number(outcome.accepted)?)
        .bind(number(outcome.duplicates)?)
        .bind(number(outcome.rejected)?)
        .bind(outcome.summary.to_string())
        .bind(batch_id)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

fn number(count: u64) -> Result<i64, StoreError> {
    i64::try_from(count).map_err(|e| StoreError::malformed("count", e))
}

/// `select` of every column of [`batch`], with what follows `from batch`.
macro_rules! select_batch {
    ($rest:literal) => {
        concat!(
            "select batch_id, model_id, source, regime, content_type, body_sha256, body_bytes, accepted, duplicates, ",
            "rejected, summary, created_at, retracted_at, erase_asked_at, erased_at from batch ",
            $rest
        )
    };
}

impl Store {
    /// The batch of this model.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn batch(&self, model_id: i64, batch_id: i64) -> Result<Option<Batch>, StoreError> {
        let row = query(select_batch!("where model_id = ? and batch_id = ?"))
            .bind(model_id)
            .bind(batch_id)
            .fetch_optional(&self.readers)
            .await?;
        row.as_ref().map(batch).transpose()
    }

    /// Up to `limit` batches of this model after `after` (0 for the first), in order of arrival.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn batches(&self, model_id: i64, after: i64, limit: u32) -> Result<Vec<Batch>, StoreError> {
        let rows = query(select_batch!("where model_id = ? and batch_id > ? order by batch_id limit ?"))
            .bind(model_id)
            .bind(after)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(batch).collect()
    }

    /// The distinct events of a batch by state; those in a queued or running task are pending.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn batch_event_counts(&self, batch_id: i64) -> Result<EventCounts, StoreError> {
        let rows = query(
            "select e.state, count(*) as events, count(e.pruned_at) as pruned
             from (select distinct event_id from batch_event where batch_id = ?) here join event e using (event_id)
             group by e.state",
        )
        .bind(batch_id)
        .fetch_all(&self.readers)
        .await?;
        let mut counts = EventCounts::default();
        for row in &rows {
            let state: &str = row.try_get("state")?;
            let slot = match state {
                "pending" | "claimed" => &mut counts.pending,
                "learned" => &mut counts.learned,
                "set_aside" => &mut counts.set_aside,
                "held" => &mut counts.held,
                "retracted" => &mut counts.retracted,
                other => return Err(StoreError::malformed("state", other)),
            };
            *slot += count::<u64>(row, "events")?;
            counts.pruned += count::<u64>(row, "pruned")?;
        }
        Ok(counts)
    }
}

fn batch(row: &SqliteRow) -> Result<Batch, StoreError> {
    let regime: Option<&str> = row.try_get("regime")?;
    let body_sha256: &[u8] = row.try_get("body_sha256")?;
    Ok(Batch {
        batch_id: row.try_get("batch_id")?,
        model_id: row.try_get("model_id")?,
        source: row.try_get("source")?,
        regime: regime.map(|_| word(row, "regime")).transpose()?,
        content_type: row.try_get("content_type")?,
        body_sha256: hex::encode(body_sha256),
        body_bytes: count(row, "body_bytes")?,
        accepted: count(row, "accepted")?,
        duplicates: count(row, "duplicates")?,
        rejected: count(row, "rejected")?,
        summary: json(row, "summary")?,
        created_at: time(row, "created_at")?,
        retracted_at: optional_time(row, "retracted_at")?,
        erase_asked_at: optional_time(row, "erase_asked_at")?,
        erased_at: optional_time(row, "erased_at")?,
    })
}
