//! Stored values and the values of the service, one into the other.

use jiff::Timestamp;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::StoreError;

/// A time as stored: microseconds always, so that the order of texts is the order of times.
pub(super) fn stored_time(time: Timestamp) -> String {
    format!("{time:.6}")
}

/// The time in column `name`.
pub(super) fn time(row: &SqliteRow, name: &'static str) -> Result<Timestamp, StoreError> {
    let text: &str = row.try_get(name)?;
    text.parse().map_err(|e| StoreError::malformed(name, e))
}

/// The time in column `name`, where there is one.
pub(super) fn optional_time(row: &SqliteRow, name: &'static str) -> Result<Option<Timestamp>, StoreError> {
    let text: Option<&str> = row.try_get(name)?;
    text.map(|text| text.parse().map_err(|e| StoreError::malformed(name, e))).transpose()
}

/// The JSON in column `name`; null in SQL is null in JSON.
pub(super) fn json<T: DeserializeOwned>(row: &SqliteRow, name: &'static str) -> Result<T, StoreError> {
    let text: Option<&str> = row.try_get(name)?;
    serde_json::from_str(text.unwrap_or("null")).map_err(|e| StoreError::malformed(name, e))
}

/// The word in column `name`: a name, a state, a method.
pub(super) fn word<T: DeserializeOwned>(row: &SqliteRow, name: &'static str) -> Result<T, StoreError> {
    let text: String = row.try_get(name)?;
    serde_json::from_value(serde_json::Value::String(text)).map_err(|e| StoreError::malformed(name, e))
}

/// The count in column `name`.
pub(super) fn count<T: TryFrom<i64>>(row: &SqliteRow, name: &'static str) -> Result<T, StoreError> {
    let number: i64 = row.try_get(name)?;
    T::try_from(number).map_err(|_| StoreError::malformed(name, format!("{number} is out of range")))
}

/// The count in column `name`, where there is one.
pub(super) fn optional_count<T: TryFrom<i64>>(row: &SqliteRow, name: &'static str) -> Result<Option<T>, StoreError> {
    let number: Option<i64> = row.try_get(name)?;
    number.map(|n| T::try_from(n).map_err(|_| StoreError::malformed(name, format!("{n} is out of range")))).transpose()
}

/// The digest in column `name`, 32 bytes.
pub(super) fn digest(row: &SqliteRow, name: &'static str) -> Result<[u8; 32], StoreError> {
    let bytes: &[u8] = row.try_get(name)?;
    bytes.try_into().map_err(|_| StoreError::malformed(name, "a digest has 32 bytes"))
}

/// SHA-256 over `parts`, one after another.
pub(super) fn sha256(parts: &[&[u8]]) -> [u8; 32] {
    let mut hasher = Sha256::new();
    for part in parts {
        hasher.update(part);
    }
    hasher.finalize().into()
}

/// Ids as a JSON array, for `json_each`.
pub(super) fn stored_ids(ids: &[i64]) -> String {
    serde_json::to_string(ids).expect("numbers are plain data")
}
