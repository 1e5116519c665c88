//! Versions: reading them, their weights and their evaluation, and the one thing that may be added later, a note.

use jiff::Timestamp;
use serde_json::Value;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, query};

use super::array::{floats, stored_floats};
use super::column::{count, digest, json, sha256, stored_time, time, word};
use super::{Part, Purpose, Store, StoreError, WriteTransaction, seal};
use crate::lineage::Version;

/// The columns of [`version_from`], never the weights; the rest of the statement follows.
macro_rules! select_version {
    ($rest:literal) => {
        concat!(
            "select v.model_id, v.version, v.task_id, v.parent, v.stage, v.regime, v.method, v.settings, v.seed, v.strength, ",
            "v.lambda, v.strength_search, v.kernel, v.train_events, v.events_sha256, v.scaling, v.importance, v.weights_sha256, ",
            "v.promotion, v.created_at, v.seal, n.note, ",
            "exists (select 1 from taint x where x.model_id = v.model_id and x.version = v.version) as tainted, ",
            "exists (select 1 from pruned p where p.model_id = v.model_id and p.version = v.version) as pruned ",
            "from version v ",
            "left join version_note n on n.model_id = v.model_id and n.version = v.version ",
            $rest
        )
    };
}

/// What can be done about a corrupt version.
pub(super) const ROLL_BACK: &str = "roll back to a good version, or restore a backup";

/// A corrupt row that can still be read is read, and says so.
fn version_from(row: &SqliteRow) -> Result<Version, StoreError> {
    let corrupt = (!seal::VERSION.is_intact(row)?).then(|| {
        let version: i64 = row.get("version");
        format!("version {version} is corrupt: the digest of its row does not match; {ROLL_BACK}")
    });
    parsed(row, corrupt.clone()).map_err(|error| match corrupt {
        Some(detail) => StoreError::corrupt(Part::Version, detail),
        None => error,
    })
}

fn parsed(row: &SqliteRow, corrupt: Option<String>) -> Result<Version, StoreError> {
    Ok(Version {
        model_id: row.try_get("model_id")?,
        version: row.try_get("version")?,
        task_id: row.try_get("task_id")?,
        parent: row.try_get("parent")?,
        stage: count(row, "stage")?,
        regime: word(row, "regime")?,
        method: word(row, "method")?,
        settings: json(row, "settings")?,
        strength: row.try_get("strength")?,
        lambda: row.try_get("lambda")?,
        strength_search: json(row, "strength_search")?,
        kernel: row.try_get("kernel")?,
        train_events: count(row, "train_events")?,
        events_sha256: hex::encode(digest(row, "events_sha256")?),
        scaling: json::<Value>(row, "scaling")?,
        importance: json::<Value>(row, "importance")?,
        weights_sha256: hex::encode(digest(row, "weights_sha256")?),
        promotion: json(row, "promotion")?,
        pruned: row.try_get("pruned")?,
        tainted: row.try_get("tainted")?,
        note: row.try_get("note")?,
        created_at: time(row, "created_at")?,
        corrupt,
    })
}

/// Digest of weights as a version keeps it, hex.
#[must_use]
pub fn weights_sha256(weights: &[f32]) -> String {
    hex::encode(sha256(&[&stored_floats(weights)]))
}

impl Store {
    /// The version, when the model has it.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn version(&self, model_id: i64, version: i64) -> Result<Option<Version>, StoreError> {
        get(&mut *self.readers.acquire().await?, model_id, version).await
    }

    /// At most `limit` versions of the model above `after`, ascending, without their weights.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn versions(&self, model_id: i64, after: i64, limit: u32) -> Result<Vec<Version>, StoreError> {
        let rows = query(select_version!("where v.model_id = ? and v.version > ? order by v.version limit ?"))
            .bind(model_id)
            .bind(after)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(version_from).collect()
    }

    /// Numbers of up to `limit` of the model's newest versions, in order.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn newest_versions(&self, model_id: i64, limit: u32) -> Result<Vec<i64>, StoreError> {
        let rows = query("select version from version where model_id = ? order by version desc limit ?")
            .bind(model_id)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().rev().map(|row| Ok(row.try_get(0)?)).collect()
    }

    /// The live version of every model that has one: row ids of models, and versions.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn live_versions(&self) -> Result<Vec<(i64, i64)>, StoreError> {
        let rows = query("select model_id, live_version from model where live_version is not null order by model_id")
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(|row| Ok((row.try_get("model_id")?, row.try_get("live_version")?))).collect()
    }

    /// The version's weights, one flat vector; never weights whose digest does not match.
    ///
    /// # Errors
    /// When there are none, they cannot be read, or they are not what was written.
    pub async fn weights(&self, model_id: i64, version: i64) -> Result<Vec<f32>, StoreError> {
        let row = query(
            "select w.weights, v.weights_sha256 from weights w join version v using (model_id, version)
             where w.model_id = ? and w.version = ?",
        )
        .bind(model_id)
        .bind(version)
        .fetch_optional(&self.readers)
        .await?;
        let row = row.ok_or_else(|| StoreError::malformed("weights", format!("version {version} has none")))?;
        let bytes: &[u8] = row.try_get("weights")?;
        if sha256(&[bytes]) != digest(&row, "weights_sha256")? {
            let detail = format!("version {version} is corrupt: the digest of its weights does not match; {ROLL_BACK}");
            self.note_corrupt(model_id, version, &detail);
            return Err(StoreError::corrupt(Part::Version, detail));
        }
        floats("weights", bytes)
    }

    /// The version's parent; none without one, and of a version that is not there.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn parent(&self, model_id: i64, version: i64) -> Result<Option<i64>, StoreError> {
        let row = query("select parent from version where model_id = ? and version = ?")
            .bind(model_id)
            .bind(version)
            .fetch_optional(&self.readers)
            .await?;
        Ok(row.map(|row| row.try_get("parent")).transpose()?.flatten())
    }
}

/// The version as this connection sees it, when the model has it.
///
/// # Errors
/// When the database cannot be read.
pub async fn get(
    connection: &mut SqliteConnection,
    model_id: i64,
    version: i64,
) -> Result<Option<Version>, StoreError> {
    let row = query(select_version!("where v.model_id = ? and v.version = ?"))
        .bind(model_id)
        .bind(version)
        .fetch_optional(connection)
        .await?;
    row.as_ref().map(version_from).transpose()
}

/// Sets the remark on a version, or takes it away; `false` when the model has no such version.
///
/// # Errors
/// When the database cannot be written.
pub async fn set_note(
    transaction: &mut WriteTransaction,
    model_id: i64,
    version: i64,
    note: Option<&str>,
    now: Timestamp,
) -> Result<bool, StoreError> {
    transaction.is_for(Purpose::VersionNoted);
    if !exists(transaction, model_id, version).await? {
        return Ok(false);
    }
    match note {
        Some(note) => {
            query(
                "insert into version_note (model_id, version, note, noted_at) values (?, ?, ?, ?)
                 on conflict (model_id, version) do update set note = excluded.note, noted_at = excluded.noted_at",
            )
            .bind(model_id)
            .bind(version)
            .bind(note)
            .bind(stored_time(now))
            .execute(&mut **transaction)
            .await?;
        }
        None => {
            query("delete from version_note where model_id = ? and version = ?")
                .bind(model_id)
                .bind(version)
                .execute(&mut **transaction)
                .await?;
        }
    }
    Ok(true)
}

/// Whether the model has the version.
///
/// # Errors
/// When the database cannot be read.
pub async fn exists(connection: &mut SqliteConnection, model_id: i64, version: i64) -> Result<bool, StoreError> {
    let row = query("select 1 from version where model_id = ? and version = ?")
        .bind(model_id)
        .bind(version)
        .fetch_optional(connection)
        .await?;
    Ok(row.is_some())
}
