//! Events that were refused, kept for inspection.

use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite, query};

use super::column::count;
use super::{Store, StoreError, WriteTransaction};
use crate::lineage::{Place, Rejection};

/// Keeps rejections of a batch, the first of them as its number `ordinal`, in order.
///
/// # Errors
/// When the database cannot be written.
pub async fn store(
    transaction: &mut WriteTransaction,
    batch_id: i64,
    ordinal: i64,
    rejections: &[Rejection],
) -> Result<(), StoreError> {
    if rejections.is_empty() {
        return Ok(());
    }
    let mut insert = QueryBuilder::<Sqlite>::new(
        "insert into rejection (batch_id, ordinal, position, name, place, at, code, detail) ",
    );
    insert.push_values(rejections.iter().zip(ordinal..), |mut row, (rejection, ordinal)| {
        row.push_bind(batch_id).push_bind(ordinal).push_bind(rejection.index.cast_signed());
        row.push_bind(rejection.event_id.as_deref()).push_bind(rejection.place.kind());
        row.push_bind(rejection.place.to_string()).push_bind(&rejection.code).push_bind(&rejection.detail);
    });
    insert.build().persistent(false).execute(&mut **transaction).await?;
    Ok(())
}

impl Store {
    /// Up to `limit` rejections of a batch from number `from` on (0 for the first), in the order of the body. The next
    /// page begins at `from` + `limit`.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn rejections(&self, batch_id: i64, from: i64, limit: u32) -> Result<Vec<Rejection>, StoreError> {
        let rows = query(
            "select position, name, place, at, code, detail from rejection
             where batch_id = ? and ordinal >= ? order by ordinal limit ?",
        )
        .bind(batch_id)
        .bind(from)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(rejection).collect()
    }
}

fn rejection(row: &SqliteRow) -> Result<Rejection, StoreError> {
    let (kind, at): (&str, &str) = (row.try_get("place")?, row.try_get("at")?);
    Ok(Rejection {
        index: count(row, "position")?,
        event_id: row.try_get("name")?,
        place: Place::parse(kind, at).ok_or_else(|| StoreError::malformed("place", format!("{kind} {at}")))?,
        code: row.try_get("code")?,
        detail: row.try_get("detail")?,
    })
}
