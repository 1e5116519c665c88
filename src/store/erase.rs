//! Content of retracted batches, taken out of the database for good, in small steps.
//!
//! What goes: arrays, names, sources and runs of events that no batch holds any more, and the words of rejections and of
//! stored answers. What stays: digests, lengths, mean speeds, ledgers, versions and measures. `secure_delete` overwrites what
//! is freed, and [`Store::fold_log`] empties the write-ahead log, which would otherwise keep it until it is written over.

use jiff::Timestamp;
use sqlx::{Row, query};

use super::column::stored_time;
use super::{Purpose, Store, StoreError, WriteTransaction};

/// Asks for the erasure of what a retracted batch held; asking again changes nothing. `false` when it is not retracted.
///
/// # Errors
/// When the database cannot be written.
pub async fn ask(transaction: &mut WriteTransaction, batch_id: i64, now: Timestamp) -> Result<bool, StoreError> {
    let asked = query(
        "update batch set erase_asked_at = coalesce(erase_asked_at, ?)
         where batch_id = ? and retracted_at is not null",
    )
    .bind(stored_time(now))
    .bind(batch_id)
    .execute(&mut **transaction)
    .await?;
    Ok(asked.rows_affected() > 0)
}

impl Store {
    /// A batch whose content is to go.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn batch_to_erase(&self) -> Result<Option<i64>, StoreError> {
        let row = query(
            "select batch_id from batch where erase_asked_at is not null and erased_at is null order by batch_id limit 1",
        )
        .fetch_optional(&self.readers)
        .await?;
        row.map(|row| Ok(row.try_get("batch_id")?)).transpose()
    }

    /// Erases the retracted among at most `limit` events of the batch from number `from` on. Gives the number to go on from;
    /// none at the end.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn erase_events(&self, batch_id: i64, from: i64, limit: u32) -> Result<Option<i64>, StoreError> {
        let mut transaction = self.begin().await?;
        transaction.is_for(Purpose::ContentErased);
        let row = query(
            "select max(ordinal) as last from (
                 select ordinal from batch_event where batch_id = ? and ordinal >= ? order by ordinal limit ?)",
        )
        .bind(batch_id)
        .bind(from)
        .bind(limit)
        .fetch_one(&mut *transaction)
        .await?;
        let Some(last) = row.try_get::<Option<i64>, _>("last")? else { return Ok(None) };
        query(
            "update event set arrays = x'', name = '', source = null, run = null
             where state = 'retracted' and length(arrays) > 0 and event_id in (
                 select event_id from batch_event where batch_id = ? and ordinal between ? and ?)",
        )
        .bind(batch_id)
        .bind(from)
        .bind(last)
        .execute(&mut *transaction)
        .await?;
        transaction.commit().await?;
        Ok(Some(last + 1))
    }

    /// Takes the words out of at most `limit` rejections of the batch from number `from` on, and at first out of its stored
    /// answer. Gives the number to go on from; none at the end.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn erase_words(&self, batch_id: i64, from: i64, limit: u32) -> Result<Option<i64>, StoreError> {
        let mut transaction = self.begin().await?;
        transaction.is_for(Purpose::ContentErased);
        query(
            "update idempotency set body = cast(json_set(cast(body as text), '$.rejected', json('[]')) as blob)
             where batch_id = ?",
        )
        .bind(batch_id)
        .execute(&mut *transaction)
        .await?;
        query(
            "update rejection set name = null, detail = 'erased'
             where batch_id = ?1 and ordinal >= ?2 and ordinal < ?2 + ?3",
        )
        .bind(batch_id)
        .bind(from)
        .bind(limit)
        .execute(&mut *transaction)
        .await?;
        let row = query("select max(ordinal) as last from rejection where batch_id = ?")
            .bind(batch_id)
            .fetch_one(&mut *transaction)
            .await?;
        transaction.commit().await?;
        let next = from + i64::from(limit);
        Ok(row.try_get::<Option<i64>, _>("last")?.filter(|&last| last >= next).map(|_| next))
    }

    /// Notes that nothing of the batch's content is left.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn note_erased(&self, batch_id: i64, now: Timestamp) -> Result<(), StoreError> {
        let mut transaction = self.begin().await?;
        transaction.is_for(Purpose::ErasureNoted);
        query("update batch set erased_at = ? where batch_id = ?")
            .bind(stored_time(now))
            .bind(batch_id)
            .execute(&mut *transaction)
            .await?;
        transaction.commit().await
    }
}
