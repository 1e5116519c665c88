//! Digests over rows: what of a row never changes is sealed by the transaction that writes it, and looked at again when it
//! is used. A number that was flipped on the disk is found where it would be believed.

use sha2::{Digest, Sha256};
use sqlx::sqlite::{Sqlite, SqliteConnection, SqliteRow};
use sqlx::{Decode, Row, Type, TypeInfo, ValueRef, query};

use super::StoreError;
use super::column::digest;

/// The schema since which rows are sealed.
pub(super) const SEALED_SINCE: i64 = 7;

/// Rows of one table that are sealed.
#[derive(Debug)]
pub(super) struct Sealed {
    /// Rows that are not sealed yet, by an index that holds no others.
    unsealed: &'static str,
    /// Seals one row, named by `key`.
    update: &'static str,
    key: &'static [&'static str],
    /// What the seal is over, in this order. A column that is added later takes no part: those before would not fit.
    columns: &'static [&'static str],
}

/// What a model learns with.
pub(super) const MODEL: Sealed = Sealed {
    unsealed: "select * from model indexed by model_unsealed where seal is null",
    update: "update model set seal = ? where model_id = ?",
    key: &["model_id"],
    columns: &["model_id", "method", "settings"],
};

/// What a version is, but for its weights, whose digest is among the columns.
pub(super) const VERSION: Sealed = Sealed {
    unsealed: "select * from version indexed by version_unsealed where seal is null",
    update: "update version set seal = ? where model_id = ? and version = ?",
    key: &["model_id", "version"],
    columns: &[
        "model_id",
        "version",
        "task_id",
        "parent",
        "stage",
        "regime",
        "method",
        "settings",
        "seed",
        "strength",
        "lambda",
        "kernel",
        "train_events",
        "events_sha256",
        "scaling",
        "importance",
        "weights_sha256",
        "promotion",
        "created_at",
        "strength_search",
    ],
};

/// How a version drives in one regime, and where what it keeps of it lies.
pub(super) const VERSION_REGIME: Sealed = Sealed {
    unsealed: "select * from version_regime indexed by version_regime_unsealed where seal is null",
    update: "update version_regime set seal = ? where model_id = ? and version = ? and position = ?",
    key: &["model_id", "version", "position"],
    columns: &[
        "model_id",
        "version",
        "position",
        "regime",
        "learned_stage",
        "learned_version",
        "anchor_id",
        "reservoir_id",
        "test_events",
        "test_steps",
        "spacing_mse",
        "speed_mse",
        "collisions",
        "before_spacing_mse",
        "before_speed_mse",
        "before_collisions",
        "diagonal_spacing_mse",
        "best_spacing_mse",
        "served_spacing_mse",
        "served_speed_mse",
        "served_collisions",
        "served_acted_steps",
        "served_held_steps",
    ],
};

/// The test events of a regime.
pub(super) const RESERVOIR: Sealed = Sealed {
    unsealed: "select * from reservoir indexed by reservoir_unsealed where seal is null",
    update: "update reservoir set seal = ? where reservoir_id = ?",
    key: &["reservoir_id"],
    columns: &["reservoir_id", "model_id", "event_ids"],
};

/// Seals every row that is not: those this transaction inserted, or those of a release that knew no seals.
///
/// # Errors
/// When the database cannot be written.
pub(super) async fn seal(connection: &mut SqliteConnection) -> Result<(), StoreError> {
    for of in [&MODEL, &VERSION, &VERSION_REGIME, &RESERVOIR] {
        let rows = query(of.unsealed).fetch_all(&mut *connection).await?;
        for row in &rows {
            let seal = of.digest(row)?;
            let mut update = query(of.update).bind(&seal[..]);
            for name in of.key {
                update = update.bind(row.try_get::<i64, _>(*name)?);
            }
            update.execute(&mut *connection).await?;
        }
    }
    Ok(())
}

impl Sealed {
    /// Whether the row is as it was when it was sealed. One that is not sealed yet is believed.
    pub(super) fn is_intact(&self, row: &SqliteRow) -> Result<bool, StoreError> {
        let sealed: Option<&[u8]> = row.try_get("seal")?;
        Ok(sealed.is_none() || self.digest(row)? == digest(row, "seal")?)
    }

    /// Over each column: its type as one byte, then integers and floats as 8 bytes, little-endian, text and blobs behind
    /// their length as such an integer.
    fn digest(&self, row: &SqliteRow) -> Result<[u8; 32], StoreError> {
        let mut hasher = Sha256::new();
        for &name in self.columns {
            let value = row.try_get_raw(name)?;
            if value.is_null() {
                hasher.update([0]);
                continue;
            }
            let kind = value.type_info().name().to_owned();
            match kind.as_str() {
                "INTEGER" => number(&mut hasher, 1, get::<i64>(row, name)?.to_le_bytes()),
                "REAL" => number(&mut hasher, 2, get::<f64>(row, name)?.to_bits().to_le_bytes()),
                "TEXT" => bytes(&mut hasher, 3, get::<&str>(row, name)?.as_bytes()),
                "BLOB" => bytes(&mut hasher, 4, get::<&[u8]>(row, name)?),
                other => return Err(StoreError::malformed(name, format!("a column of type {other}"))),
            }
        }
        Ok(hasher.finalize().into())
    }
}

fn get<'r, T: Decode<'r, Sqlite> + Type<Sqlite>>(row: &'r SqliteRow, name: &str) -> Result<T, StoreError> {
    Ok(row.try_get(name)?)
}

fn number(hasher: &mut Sha256, kind: u8, value: [u8; 8]) {
    hasher.update([kind]);
    hasher.update(value);
}

fn bytes(hasher: &mut Sha256, kind: u8, value: &[u8]) {
    number(hasher, kind, (value.len() as u64).to_le_bytes());
    hasher.update(value);
}

#[cfg(test)]
mod tests {
    use super::super::fixture::Fixture;
    use super::*;
    use crate::consolidation::Method;
    use crate::lineage::ModelSettings;

    async fn is_intact(fixture: &Fixture) -> bool {
        let mut transaction = fixture.store.begin().await.unwrap();
        let row = query("select * from model").fetch_one(&mut *transaction).await.unwrap();
        MODEL.is_intact(&row).unwrap()
    }

    #[tokio::test]
    async fn a_sealed_row_tells_a_change_of_what_never_changes_and_of_nothing_else() {
        let fixture = Fixture::new().await;
        fixture.model("m", Method::Ewc, &ModelSettings::default()).await;
        let mut transaction = fixture.store.begin().await.unwrap();
        seal(&mut transaction).await.unwrap();
        transaction.commit().await.unwrap();
        fixture.execute("update model set paused = 1, revision = 7, live_version = 3").await;
        assert!(is_intact(&fixture).await);
        fixture.execute("update model set settings = replace(settings, '0.1', '0.2')").await;
        assert!(!is_intact(&fixture).await);
    }

    #[tokio::test]
    async fn rows_that_nobody_sealed_are_sealed_when_the_database_is_opened() {
        let fixture = Fixture::new().await;
        fixture.model("m", Method::Ewc, &ModelSettings::default()).await;
        fixture.execute("update model set seal = null").await;
        let fixture = fixture.reopened().await;
        fixture.execute("update model set method = 'mas'").await;
        assert!(!is_intact(&fixture).await);
    }
}
