//! What is to be copied is what was written: new seals would hide what the old ones tell. Digests of content are copied along
//! with it, so that they go on telling.

use futures_util::TryStreamExt;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, query};

use super::rows_of;
use crate::car_following::Event;
use crate::store::column::{digest, sha256};
use crate::store::line::with_line;
use crate::store::seal::{MODEL, RESERVOIR, Sealed, VERSION, VERSION_REGIME};
use crate::store::{Part, Store, StoreError};

/// Rows that are sealed, what they are, and which of them are chosen.
const SEALS: [(&Sealed, Part, &str, &str); 4] = [
    (&MODEL, Part::Model, "the model's settings", "select m.* from from_model m where m.model_id = ?1"),
    (
        &VERSION,
        Part::Version,
        "the row of a version",
        "select v.* from chosen_version c cross join from_version v on v.model_id = ?1 and v.version = c.version",
    ),
    (
        &VERSION_REGIME,
        Part::Version,
        "the evaluation of a version",
        "select r.* from chosen_version c cross join from_version_regime r on r.model_id = ?1 and r.version = c.version",
    ),
    (
        &RESERVOIR,
        Part::Reservoir,
        "the test events of a regime",
        "select r.* from chosen_reservoir c cross join from_reservoir r on r.reservoir_id = c.old",
    ),
];

const WEIGHTS: &str = "select w.weights as first, x'' as second, v.weights_sha256 as sha256
    from chosen_version c cross join from_weights w on w.model_id = ?1 and w.version = c.version
    cross join from_version v on v.model_id = ?1 and v.version = c.version";

/// But those that retention emptied.
const ANCHORS: &str = "select a.importance as first, a.weights as second, a.anchor_sha256 as sha256
    from chosen_anchor c cross join from_anchor a on a.anchor_id = c.old where length(a.importance) > 0";

/// Seals and digests of everything chosen but the events.
pub(super) async fn look(connection: &mut SqliteConnection, of: i64) -> Result<(), StoreError> {
    for (sealed, part, what, statement) in SEALS {
        for row in rows_of(connection, statement, of).await? {
            if !sealed.is_intact(&row)? {
                return Err(corrupt(part, what));
            }
        }
    }
    for (part, what, statement) in
        [(Part::Version, "the weights of a version", WEIGHTS), (Part::Anchor, "what is kept of a regime", ANCHORS)]
    {
        let mut rows = query(statement).bind(of).fetch(&mut *connection);
        while let Some(row) = rows.try_next().await? {
            if sha256(&[row.try_get("first")?, row.try_get("second")?]) != digest(&row, "sha256")? {
                return Err(corrupt(part, what));
            }
        }
    }
    Ok(())
}

fn corrupt(part: Part, what: &str) -> StoreError {
    StoreError::corrupt(part, format!("{what} is corrupt: its digest does not match; nothing was copied"))
}

/// Events of the line but those whose arrays are gone.
const EVENTS: &str = with_line!(
    "?2",
    "select e.name, e.content_sha256, e.dt_s, e.arrays from line
     cross join task_event te on te.task_id = line.task_id cross join event e on e.event_id = te.event_id
     where length(e.arrays) > 0"
);

fn event(row: &SqliteRow) -> Result<(), StoreError> {
    let (dt_s, arrays): (f64, &[u8]) = (row.try_get("dt_s")?, row.try_get("arrays")?);
    if Event::digest_of(dt_s, arrays) == digest(row, "content_sha256")? {
        return Ok(());
    }
    let name: &str = row.try_get("name")?;
    Err(corrupt(Part::Event, &format!("event {name}")))
}

impl Store {
    /// Whether every event that the version's line learned is what was written.
    ///
    /// # Errors
    /// When one is not, or the database cannot be read.
    pub async fn look_at_line(&self, model_id: i64, version: i64) -> Result<(), StoreError> {
        let mut rows = query(EVENTS).bind(model_id).bind(version).fetch(&self.readers);
        while let Some(row) = rows.try_next().await? {
            event(&row)?;
        }
        Ok(())
    }
}
