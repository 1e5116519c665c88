//! Where a model stands: live, head, revision; and what follows for the events of its line.

use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query};

use super::line::with_line;
use super::{StoreError, WriteTransaction};

/// A model's pointers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pointers {
    /// The version that serves.
    pub(super) live: Option<i64>,
    /// The version the next task starts from.
    pub(super) head: Option<i64>,
    /// As of reading.
    pub(super) revision: i64,
}

/// The pointers of a model that is known to exist.
pub(super) async fn read(connection: &mut SqliteConnection, model_id: i64) -> Result<Pointers, StoreError> {
    let row = query("select live_version, head_version, revision from model where model_id = ?")
        .bind(model_id)
        .fetch_one(connection)
        .await?;
    Ok(Pointers {
        live: row.try_get("live_version")?,
        head: row.try_get("head_version")?,
        revision: row.try_get("revision")?,
    })
}

/// Moves the pointers; the revision grows.
pub(super) async fn write(
    transaction: &mut WriteTransaction,
    model_id: i64,
    pointers: &Pointers,
) -> Result<(), StoreError> {
    query("update model set live_version = ?, head_version = ?, revision = revision + 1 where model_id = ?")
        .bind(pointers.live)
        .bind(pointers.head)
        .bind(model_id)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

/// Events of an ended task that the head's line had learned before stay learned.
pub(super) async fn learned_again(transaction: &mut WriteTransaction, task_id: i64) -> Result<(), StoreError> {
    query(
        "with recursive line (model_id, version, parent, task_id) as (
             select v.model_id, v.version, v.parent, v.task_id from task t join model m on m.model_id = t.model_id
             join version v on v.model_id = m.model_id and v.version = m.head_version where t.task_id = ?1
             union all
             select v.model_id, v.version, v.parent, v.task_id from line
             join version v on v.model_id = line.model_id and v.version = line.parent and v.version < line.version
         )
         update event set state = 'learned'
         where state in ('held', 'set_aside')
             and event_id in (select event_id from task_event where task_id = ?1)
             and event_id in (select te.event_id from line cross join task_event te on te.task_id = line.task_id)",
    )
    .bind(task_id)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// After the head moved anywhere: an event is learned when the head's line learned it, and set aside when only other
/// versions did.
pub(super) async fn settle_events(transaction: &mut WriteTransaction, model_id: i64) -> Result<(), StoreError> {
    for statement in [LEARNED_ON_THE_LINE, SET_ASIDE_OFF_THE_LINE] {
        query(statement).bind(model_id).execute(&mut **transaction).await?;
    }
    Ok(())
}

const LEARNED_ON_THE_LINE: &str = with_line!(
    "(select head_version from model where model_id = ?1)",
    "update event set state = 'learned'
    where state in ('held', 'set_aside')
        and event_id in (select te.event_id from line cross join task_event te on te.task_id = line.task_id)"
);

const SET_ASIDE_OFF_THE_LINE: &str = with_line!(
    "(select head_version from model where model_id = ?1)",
    "update event set state = 'set_aside'
    where state = 'learned'
        and event_id in (select te.event_id from version v join task_event te on te.task_id = v.task_id
                         where v.model_id = ?1 and v.version not in (select version from line))
        and event_id not in (select te.event_id from line cross join task_event te on te.task_id = line.task_id)"
);
