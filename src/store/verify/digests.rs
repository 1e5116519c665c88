//! Every digest over what it is of.

use futures_util::TryStreamExt;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, query};

use super::{Findings, count};
use crate::car_following::Event;
use crate::store::StoreError;
use crate::store::column::{digest, sha256};
use crate::store::seal::{MODEL, RESERVOIR, SEALED_SINCE, Sealed, VERSION, VERSION_REGIME};

/// Whether a row is as it was written; otherwise where it is, and what is wrong.
type Look = fn(&SqliteRow) -> Result<Option<(String, String)>, StoreError>;

/// Name, rows in all, the rows, and what is to hold of each.
const CHECKS: [(&str, &str, &str, Look); 4] = [
    (
        "events",
        "select count(*) from kept_event",
        "select e.batch_id, e.name, e.content_sha256, e.dt_s, e.steps, e.arrays, m.name as model
         from kept_event e left join model m using (model_id)",
        event,
    ),
    (
        "weights",
        "select count(*) from weights",
        "select w.version, w.weights, v.weights_sha256 as sha256, m.name as model
         from weights w left join version v using (model_id, version) left join model m using (model_id)",
        weights,
    ),
    (
        "anchors",
        "select count(*) from kept_anchor",
        "select a.anchor_id, a.importance, a.weights, a.anchor_sha256 as sha256, m.name as model
         from kept_anchor a left join model m using (model_id)",
        anchor,
    ),
    (
        "checkpoints",
        "select count(*) from checkpoint",
        "select task_id, state, state_sha256 as sha256 from checkpoint",
        checkpoint,
    ),
];

/// Rows that carry a seal.
const SEALS: [(&str, &str, &str, &Sealed); 4] = [
    ("seals of models", "select count(*) from model", "select *, name as place from model", &MODEL),
    (
        "seals of versions",
        "select count(*) from version",
        "select v.*, format('model %s, version %d', m.name, v.version) as place
         from version v left join model m using (model_id)",
        &VERSION,
    ),
    (
        "seals of evaluations",
        "select count(*) from version_regime",
        "select r.*, format('model %s, version %d, regime %s', m.name, r.version, r.regime) as place
         from version_regime r left join model m using (model_id)",
        &VERSION_REGIME,
    ),
    (
        "seals of test reservoirs",
        "select count(*) from reservoir",
        "select r.*, format('model %s, test reservoir %d', m.name, r.reservoir_id) as place
         from reservoir r left join model m using (model_id)",
        &RESERVOIR,
    ),
];

pub(super) async fn look(
    connection: &mut SqliteConnection,
    schema: i64,
    findings: &mut Findings<'_>,
) -> Result<(), StoreError> {
    for (check, all, rows, holds) in CHECKS {
        findings.begin(check, count(connection, all).await.unwrap_or_default());
        let outcome = each(connection, rows, findings, holds).await;
        findings.end(outcome)?;
    }
    for (check, all, rows, sealed) in SEALS.into_iter().filter(|_| schema >= SEALED_SINCE) {
        findings.begin(check, count(connection, all).await.unwrap_or_default());
        let holds = |row: &SqliteRow| {
            let intact = sealed.is_intact(row)?;
            Ok((!intact).then(|| (row.get::<String, _>("place"), "the digest of its row does not match".to_owned())))
        };
        let outcome = each(connection, rows, findings, holds).await;
        findings.end(outcome)?;
    }
    Ok(())
}

async fn each(
    connection: &mut SqliteConnection,
    statement: &'static str,
    findings: &mut Findings<'_>,
    holds: impl Fn(&SqliteRow) -> Result<Option<(String, String)>, StoreError>,
) -> Result<(), StoreError> {
    let mut rows = query(statement).fetch(connection);
    while let Some(row) = rows.try_next().await? {
        findings.looked();
        if let Some((place, detail)) = holds(&row)? {
            findings.fault(place, detail);
        }
    }
    Ok(())
}

fn model(row: &SqliteRow) -> Result<String, StoreError> {
    Ok(row.try_get::<Option<String>, _>("model")?.unwrap_or_else(|| "?".to_owned()))
}

fn event(row: &SqliteRow) -> Result<Option<(String, String)>, StoreError> {
    let (dt_s, arrays): (f64, &[u8]) = (row.try_get("dt_s")?, row.try_get("arrays")?);
    let (steps, batch_id): (i64, i64) = (row.try_get("steps")?, row.try_get("batch_id")?);
    let wrong = if Event::digest_of(dt_s, arrays) != digest(row, "content_sha256")? {
        "the digest of its arrays does not match"
    } else if i64::try_from(arrays.len()) != Ok(12 * steps) {
        "its arrays have not as many steps as it says"
    } else {
        return Ok(None);
    };
    let place = format!("model {}, batch b{batch_id}, event {}", model(row)?, row.try_get::<&str, _>("name")?);
    Ok(Some((place, wrong.to_owned())))
}

/// Whether the digest of a row is over these parts; what it is of may be gone altogether.
fn fits(row: &SqliteRow, parts: &[&[u8]]) -> Result<bool, StoreError> {
    let known = row.try_get::<Option<&[u8]>, _>("sha256")?.is_some();
    Ok(known && digest(row, "sha256")? == sha256(parts))
}

fn weights(row: &SqliteRow) -> Result<Option<(String, String)>, StoreError> {
    if fits(row, &[row.try_get("weights")?])? {
        return Ok(None);
    }
    let place = format!("model {}, version {}", model(row)?, row.try_get::<i64, _>("version")?);
    Ok(Some((place, "the digest of its weights does not match".to_owned())))
}

fn anchor(row: &SqliteRow) -> Result<Option<(String, String)>, StoreError> {
    if fits(row, &[row.try_get("importance")?, row.try_get("weights")?])? {
        return Ok(None);
    }
    let place = format!("model {}, anchor {}", model(row)?, row.try_get::<i64, _>("anchor_id")?);
    Ok(Some((place, "the digest of its importance and weights does not match".to_owned())))
}

fn checkpoint(row: &SqliteRow) -> Result<Option<(String, String)>, StoreError> {
    if fits(row, &[row.try_get("state")?])? {
        return Ok(None);
    }
    let place = format!("task t{}", row.try_get::<i64, _>("task_id")?);
    Ok(Some((place, "the digest of its checkpoint does not match; it would start afresh".to_owned())))
}
