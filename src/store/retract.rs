//! Retracting a batch that was never learned.

use jiff::Timestamp;
use sqlx::{Row, query};

use super::column::stored_time;
use super::{StoreError, WriteTransaction};

/// What came of a wish to retract.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Retracted {
    /// Its events that no other batch holds are retracted: so many.
    Done {
        /// Events.
        events: u64,
    },
    /// It was retracted before; nothing changed.
    Before,
    /// The model has no such batch.
    Unknown,
    /// A version learned some of its events.
    Learned,
    /// A queued or running task has some of its events.
    Claimed,
}

/// Retracts a batch when no version has learned and no task has claimed what only this batch holds.
///
/// # Errors
/// When the database cannot be written.
pub async fn retract(
    transaction: &mut WriteTransaction,
    model_id: i64,
    batch_id: i64,
    now: Timestamp,
) -> Result<Retracted, StoreError> {
    let row = query("select retracted_at from batch where batch_id = ? and model_id = ?")
        .bind(batch_id)
        .bind(model_id)
        .fetch_optional(&mut **transaction)
        .await?;
    let Some(row) = row else { return Ok(Retracted::Unknown) };
    if row.try_get::<Option<String>, _>("retracted_at")?.is_some() {
        return Ok(Retracted::Before);
    }
    query("update batch set retracted_at = ? where batch_id = ?")
        .bind(stored_time(now))
        .bind(batch_id)
        .execute(&mut **transaction)
        .await?;
    if let Some(conflict) = conflict(transaction, batch_id).await? {
        query("update batch set retracted_at = null where batch_id = ?")
            .bind(batch_id)
            .execute(&mut **transaction)
            .await?;
        return Ok(conflict);
    }
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
    Ok(Retracted::Done { events: retracted.rows_affected() })
}

/// Why the events that no unretracted batch holds any more cannot be taken away.
async fn conflict(transaction: &mut WriteTransaction, batch_id: i64) -> Result<Option<Retracted>, StoreError> {
    let row = query(
        "select
             coalesce(max(e.state = 'learned' or exists (select 1 from task_event te join task t using (task_id)
                          where te.event_id = e.event_id and t.state = 'succeeded')), 0) as learned,
             coalesce(max(e.state = 'claimed'), 0) as claimed
         from (select distinct event_id from batch_event where batch_id = ?) here
         join event e on e.event_id = here.event_id
         where not exists (select 1 from batch_event o join batch b using (batch_id)
                           where o.event_id = e.event_id and b.retracted_at is null)",
    )
    .bind(batch_id)
    .fetch_one(&mut **transaction)
    .await?;
    Ok(if row.try_get::<i64, _>("learned")? == 1 {
        Some(Retracted::Learned)
    } else if row.try_get::<i64, _>("claimed")? == 1 {
        Some(Retracted::Claimed)
    } else {
        None
    })
}
