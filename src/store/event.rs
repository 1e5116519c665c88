//! Events: each content once a model, however often it is uploaded.

use std::collections::HashMap;

use jiff::Timestamp;
use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite};

use super::column::{digest, stored_time};
use super::{StoreError, WriteTransaction};
use crate::car_following::Event;
use crate::lineage::{RegimeName, Split};

/// Most events stored with one statement: beyond some dozens, each of them costs little more than by itself.
pub const STORED_AT_ONCE: usize = 64;

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
    /// Whether it waits until its source is released.
    pub held: bool,
}

/// Where an event of a batch is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Link {
    /// Row id of the event.
    pub event_id: i64,
    /// Whether the model had its content already.
    pub duplicate: bool,
}

/// Stores events that arrive in `batch_id`, at most [`STORED_AT_ONCE`], and tells where, in their order. Of content that
/// the model has, or that is among them before, nothing is stored, unless what is stored is corrupt: then it is mended.
/// Content that was retracted waits again as if it were new; of everything else the first copy decides.
///
/// # Errors
/// When the database cannot be written.
pub async fn store(
    transaction: &mut WriteTransaction,
    model_id: i64,
    batch_id: i64,
    arriving: &[NewEvent],
    now: Timestamp,
) -> Result<Vec<Link>, StoreError> {
    let mut stored = insert(transaction, model_id, batch_id, arriving, now).await?;
    let known: Vec<_> =
        arriving.iter().map(|event| event.content_sha256).filter(|it| !stored.contains_key(it)).collect();
    let known = find(transaction, model_id, &known).await?;
    let mut links = Vec::with_capacity(arriving.len());
    for event in arriving {
        let digest = event.content_sha256;
        // Of copies among them the first is the one that was stored.
        let new = stored.get_mut(&digest).map(|(event_id, linked)| (*event_id, std::mem::replace(linked, true)));
        let (event_id, duplicate) = new
            .or_else(|| known.get(&digest).map(|&event_id| (event_id, true)))
            .ok_or_else(|| StoreError::malformed("event", "content that was there is gone"))?;
        links.push(Link { event_id, duplicate });
    }
    Ok(links)
}

/// Row ids of the events that are new, or were retracted (`false`), or are mended (`true`), by digest.
async fn insert(
    transaction: &mut WriteTransaction,
    model_id: i64,
    batch_id: i64,
    arriving: &[NewEvent],
    now: Timestamp,
) -> Result<HashMap<[u8; 32], (i64, bool)>, StoreError> {
    if arriving.is_empty() {
        return Ok(HashMap::new());
    }
    let arrived_at = stored_time(now);
    let mut insert = QueryBuilder::<Sqlite>::new(
        "insert into event (model_id, content_sha256, batch_id, name, source, run, split, regime, state, dt_s, steps,
             mean_speed_mps, arrived_at, arrays) ",
    );
    insert.push_values(arriving, |mut row, arriving| {
        let event = &arriving.event;
        row.push_bind(model_id).push_bind(&arriving.content_sha256[..]).push_bind(batch_id);
        row.push_bind(&arriving.name).push_bind(arriving.source.as_deref()).push_bind(arriving.run.as_deref());
        row.push_bind(arriving.split.as_str()).push_bind(arriving.regime.as_str()).push_bind(if arriving.held {
            "held"
        } else {
            "pending"
        });
        row.push_bind(event.dt_s()).push_bind(i64::try_from(event.steps()).expect("an event's steps are bounded"));
        row.push_bind(event.mean_speed_mps()).push_bind(&arrived_at).push_bind(event.to_bytes());
    });
    // A conflict with content that still counts and is whole updates nothing, and then no row comes back.
    insert.push(
        " on conflict (model_id, content_sha256) do update set
             dt_s = excluded.dt_s, steps = excluded.steps, arrays = excluded.arrays,
             pruned_at = null,
             batch_id = iif(state = 'retracted', excluded.batch_id, batch_id),
             name = iif(state = 'retracted', excluded.name, name),
             source = iif(state = 'retracted', excluded.source, source),
             run = iif(state = 'retracted', excluded.run, run),
             split = iif(state = 'retracted', excluded.split, split),
             regime = iif(state = 'retracted', excluded.regime, regime),
             arrived_at = iif(state = 'retracted', excluded.arrived_at, arrived_at),
             state = iif(state = 'retracted', excluded.state, state)
         where state = 'retracted' or arrays <> excluded.arrays or dt_s <> excluded.dt_s
         returning event_id, content_sha256, batch_id",
    );
    let rows = run(insert, arriving.len(), transaction).await?;
    // What was mended stays where it was.
    let linked = |row: &SqliteRow| Ok::<_, StoreError>(row.try_get::<i64, _>("batch_id")? != batch_id);
    let stored = |row| Ok((digest(row, "content_sha256")?, (row.try_get("event_id")?, linked(row)?)));
    rows.iter().map(stored).collect()
}

/// Row ids of the model's events with this content, by digest.
async fn find(
    transaction: &mut WriteTransaction,
    model_id: i64,
    content: &[[u8; 32]],
) -> Result<HashMap<[u8; 32], i64>, StoreError> {
    if content.is_empty() {
        return Ok(HashMap::new());
    }
    let mut select =
        QueryBuilder::<Sqlite>::new("select event_id, content_sha256 from event where content_sha256 in (");
    let mut digests = select.separated(", ");
    for digest in content {
        digests.push_bind(&digest[..]);
    }
    select.push(") and model_id = ").push_bind(model_id);
    let rows = run(select, content.len(), transaction).await?;
    rows.iter().map(|row| Ok((digest(row, "content_sha256")?, row.try_get("event_id")?))).collect()
}

/// Notes that a batch holds these events, the first of them at `ordinal`, in order: at most [`STORED_AT_ONCE`].
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
    run(insert, links.len(), transaction).await?;
    Ok(())
}

/// Runs a statement about `length` things. Only that about the most of them is kept prepared: those of every other length
/// would push the other statements out.
async fn run(
    mut statement: QueryBuilder<Sqlite>,
    length: usize,
    transaction: &mut WriteTransaction,
) -> Result<Vec<SqliteRow>, StoreError> {
    Ok(statement.build().persistent(length == STORED_AT_ONCE).fetch_all(&mut **transaction).await?)
}
