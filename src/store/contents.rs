//! What a batch holds, some events at a time: for a file, which need not be in memory as a whole.

use sqlx::sqlite::SqliteRow;
use sqlx::{Row, query};

use super::column::{digest, word};
use super::ledger::corrupt;
use super::{Store, StoreError};
use crate::car_following::Event;
use crate::lineage::StoredEvent;

/// Events read at once.
const EVENTS_AT_ONCE: u32 = 16;
/// Steps that are enough to be handed on.
const STEPS_AT_ONCE: usize = 1 << 15;

/// What is still to be read of a batch.
#[derive(Debug)]
pub struct Contents {
    batch_id: i64,
    /// Number of the next event; none at the end.
    next: Option<i64>,
}

impl Contents {
    /// All of a batch.
    #[must_use]
    pub fn of(batch_id: i64) -> Self {
        Self { batch_id, next: Some(0) }
    }

    /// Whether there is nothing more.
    #[must_use]
    pub fn have_ended(&self) -> bool {
        self.next.is_none()
    }

    /// The next events, in the order of the body: some tens of thousands of steps. Of copies in the body there is the first;
    /// what is retracted, erased or not kept is left out.
    ///
    /// # Errors
    /// When the database cannot be read, or an event is not what was uploaded.
    pub async fn read(&mut self, store: &Store) -> Result<Vec<StoredEvent>, StoreError> {
        let (mut events, mut steps) = (Vec::new(), 0);
        while let Some(from) = self.next
            && steps < STEPS_AT_ONCE
        {
            let (more, next) = store.batch_contents(self.batch_id, from, EVENTS_AT_ONCE).await?;
            steps += more.iter().map(|stored| stored.event.steps()).sum::<usize>();
            events.extend(more);
            self.next = next;
        }
        Ok(events)
    }
}

impl Store {
    /// Up to `limit` events of a batch from number `from` on, and the number to go on from; none when there are no more.
    async fn batch_contents(
        &self,
        batch_id: i64,
        from: i64,
        limit: u32,
    ) -> Result<(Vec<StoredEvent>, Option<i64>), StoreError> {
        let rows = query(
            "select link.ordinal, name, source, run, split, dt_s, content_sha256, arrays, event.batch_id
             from batch_event link join event on event.event_id = link.event_id
             where link.batch_id = ? and link.ordinal >= ? and event.state <> 'retracted' and length(event.arrays) > 0
                 and (link.duplicate = 0 or not exists (
                     select 1 from batch_event earlier where earlier.event_id = link.event_id
                         and earlier.batch_id = link.batch_id and earlier.ordinal < link.ordinal))
             order by link.ordinal limit ?",
        )
        .bind(batch_id)
        .bind(from)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        let next = match rows.last() {
            Some(last) if rows.len() as u64 == u64::from(limit) => Some(last.try_get::<i64, _>("ordinal")? + 1),
            _ => None,
        };
        Ok((rows.iter().map(stored).collect::<Result<_, _>>()?, next))
    }
}

fn stored(row: &SqliteRow) -> Result<StoredEvent, StoreError> {
    let (dt_s, arrays) = (row.try_get("dt_s")?, row.try_get("arrays")?);
    let sha256 = digest(row, "content_sha256")?;
    let event = Event::from_bytes(dt_s, arrays).filter(|_| Event::digest_of(dt_s, arrays) == sha256);
    let Some(event) = event else { return Err(corrupt(row)?) };
    Ok(StoredEvent {
        event_id: row.try_get("name")?,
        source: row.try_get("source")?,
        run: row.try_get("run")?,
        split: word(row, "split")?,
        event,
    })
}
