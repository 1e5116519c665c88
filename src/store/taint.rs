//! Versions that learned what was retracted later.

use jiff::Timestamp;
use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query};

use super::column::{stored_ids, stored_time};
use super::{Store, StoreError, WriteTransaction};

/// Marks the versions that these tasks made, and every version that continues one of them, but for those that are marked.
/// `false` when there is no such version.
pub(super) async fn mark(
    transaction: &mut WriteTransaction,
    model_id: i64,
    batch_id: i64,
    tasks: &[i64],
    now: Timestamp,
) -> Result<bool, StoreError> {
    let marked = query(
        "with recursive tainted (version) as (
             select v.version from json_each(?2) of cross join version v on v.task_id = of.value where v.model_id = ?1
             union
             select v.version from tainted cross join version v on v.model_id = ?1 and v.parent = tainted.version
         )
         insert into taint (model_id, version, batch_id, tainted_at) select ?1, version, ?3, ?4 from tainted
         where not exists (select 1 from taint x where x.model_id = ?1 and x.version = tainted.version)",
    )
    .bind(model_id)
    .bind(stored_ids(tasks))
    .bind(batch_id)
    .bind(stored_time(now))
    .execute(&mut **transaction)
    .await?;
    Ok(marked.rows_affected() > 0)
}

/// A version is tainted as its parent is.
pub(super) async fn inherit(
    transaction: &mut WriteTransaction,
    model_id: i64,
    version: i64,
    now: Timestamp,
) -> Result<(), StoreError> {
    query(
        "insert into taint (model_id, version, batch_id, tainted_at)
         select ?1, ?2, x.batch_id, ?3 from taint x where x.model_id = ?1
             and x.version = (select v.parent from version v where v.model_id = ?1 and v.version = ?2)",
    )
    .bind(model_id)
    .bind(version)
    .bind(stored_time(now))
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

impl Store {
    /// Whether the version learned what was retracted later, or continues one that did.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn is_tainted(&self, model_id: i64, version: i64) -> Result<bool, StoreError> {
        is_tainted(&mut *self.readers.acquire().await?, model_id, version).await
    }
}

/// Whether the version is marked.
pub(super) async fn is_tainted(
    connection: &mut SqliteConnection,
    model_id: i64,
    version: i64,
) -> Result<bool, StoreError> {
    let row = query("select exists (select 1 from taint where model_id = ? and version = ?) as tainted")
        .bind(model_id)
        .bind(version)
        .fetch_one(connection)
        .await?;
    Ok(row.try_get("tainted")?)
}
