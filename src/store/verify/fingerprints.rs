//! Whether the ledger still says what each version learned.

use futures_util::TryStreamExt;
use sha2::{Digest, Sha256};
use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query};

use super::{Findings, count};
use crate::store::StoreError;
use crate::store::column::digest;
use crate::store::line::with_line;

/// Digests of the training events of one task, ascending.
const OF_THE_TASK: &str = "select e.content_sha256 from version v join task_event te using (task_id)
    join event e using (event_id)
    where v.model_id = ?1 and v.version = ?2 and e.split = 'train' order by e.content_sha256";

/// Of the tasks of a version and of all its parents: what `joint` learns.
const OF_THE_LINE: &str = with_line!(
    "?2",
    "select e.content_sha256 from event e
     where e.split = 'train' and e.event_id in (
         select te.event_id from line cross join task_event te on te.task_id = line.task_id
     )
     order by e.content_sha256"
);

/// A version and what it says it learned.
struct Said {
    model_id: i64,
    version: i64,
    joint: bool,
    train_events: i64,
    sha256: [u8; 32],
    place: String,
}

pub(super) async fn look(connection: &mut SqliteConnection, findings: &mut Findings<'_>) -> Result<(), StoreError> {
    findings.begin("fingerprints", count(connection, "select count(*) from version").await.unwrap_or_default());
    // What was retracted and uploaded anew may be on another side now: of what is tainted the ledger tells no more.
    let rows = query(
        "select v.model_id, v.version, v.method, v.train_events, v.events_sha256,
             format('model %s, version %d', m.name, v.version) as place
         from version v left join model m using (model_id) where v.task_id is not null
             and not exists (select 1 from tainted t where t.model_id = v.model_id and t.version = v.version)",
    )
    .fetch_all(&mut *connection)
    .await?;
    let said = |row: &sqlx::sqlite::SqliteRow| {
        Ok::<_, StoreError>(Said {
            model_id: row.try_get("model_id")?,
            version: row.try_get("version")?,
            joint: row.try_get::<&str, _>("method")? == "joint",
            train_events: row.try_get("train_events")?,
            sha256: digest(row, "events_sha256")?,
            place: row.try_get("place")?,
        })
    };
    for row in &rows {
        let said = said(row)?;
        findings.looked();
        let (events, sha256) = ledger(connection, &said).await?;
        if events != said.train_events {
            let detail = format!("it learned {} training events, its ledger has {events}", said.train_events);
            findings.fault(said.place, detail);
        } else if sha256 != said.sha256 {
            findings.fault(said.place, "the fingerprint of what it learned is not that of its ledger");
        }
    }
    Ok(())
}

/// Number and digest of the training events behind a version.
async fn ledger(connection: &mut SqliteConnection, of: &Said) -> Result<(i64, [u8; 32]), StoreError> {
    let statement = if of.joint { OF_THE_LINE } else { OF_THE_TASK };
    let mut rows = query(statement).bind(of.model_id).bind(of.version).fetch(connection);
    let (mut events, mut hasher) = (0, Sha256::new());
    while let Some(row) = rows.try_next().await? {
        events += 1;
        hasher.update(digest(&row, "content_sha256")?);
    }
    Ok((events, hasher.finalize().into()))
}
