//! Keys: made, listed, revoked; never deleted.

use jiff::Timestamp;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, query};

use super::column::{digest, json, optional_time, stored_time, time};
use super::{Purpose, Store, StoreError, WriteTransaction};
use crate::access::{Issued, Key, KeyId, KeyState, KeyWish, Scope, StoredKey};

/// Why no key was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoKey {
    /// As many as the server keeps are there.
    #[error("{0} keys are there, those that have ended included; access.max_keys allows no more")]
    TooMany(u32),
    /// A key with this public part is there.
    #[error("a key {0} is there already")]
    Known(KeyId),
}

/// What came of a wish to revoke a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Revoked {
    /// It opens nothing any more, from now or from earlier on.
    Done(Key),
    /// There is no such key.
    Unknown,
    /// It is the last active admin key, and that was not meant.
    LastAdmin,
}

/// `select` of every column of [`key_from`], with what follows `from access_key`.
macro_rules! select_key {
    ($rest:literal) => {
        concat!(
            "select access_key_id, key_id, secret_sha256, name, scopes, models, created_at, expires_at, revoked_at ",
            "from access_key ",
            $rest
        )
    };
}

fn key_from(row: &SqliteRow) -> Result<Key, StoreError> {
    let key_id: &str = row.try_get("key_id")?;
    Ok(Key {
        key_id: KeyId::parse(key_id).ok_or_else(|| StoreError::malformed("key_id", key_id))?,
        name: row.try_get("name")?,
        scopes: json(row, "scopes")?,
        models: json(row, "models")?,
        created_at: time(row, "created_at")?,
        expires_at: optional_time(row, "expires_at")?,
        revoked_at: optional_time(row, "revoked_at")?,
    })
}

impl Store {
    /// At most `limit` keys that were made after the one with row id `after`, each behind its own, in order of creation.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn keys(&self, after: i64, limit: u32) -> Result<Vec<(i64, Key)>, StoreError> {
        let rows = query(select_key!("where access_key_id > ? order by access_key_id limit ?"))
            .bind(after)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(|row| Ok((row.try_get("access_key_id")?, key_from(row)?))).collect()
    }

    /// The key with this public part.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn key(&self, key_id: KeyId) -> Result<Option<Key>, StoreError> {
        let row = query(select_key!("where key_id = ?")).bind(key_id.to_string()).fetch_optional(&self.readers).await?;
        row.as_ref().map(key_from).transpose()
    }

    /// Every key with what recognises it; how many there can be is bounded when they are made.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn stored_keys(&self) -> Result<Vec<StoredKey>, StoreError> {
        let rows = query(select_key!("order by access_key_id")).fetch_all(&self.readers).await?;
        let stored =
            |row: &SqliteRow| Ok(StoredKey { key: key_from(row)?, secret_sha256: digest(row, "secret_sha256")? });
        rows.iter().map(stored).collect()
    }
}

/// Makes a key known, unless there are `max_keys`.
///
/// # Errors
/// When the database cannot be written.
pub async fn create(
    transaction: &mut WriteTransaction,
    issued: &Issued,
    wish: &KeyWish,
    max_keys: u32,
    now: Timestamp,
) -> Result<Result<Key, NoKey>, StoreError> {
    transaction.is_for(Purpose::KeyCreated);
    let row = query("select count(*) as keys from access_key").fetch_one(&mut **transaction).await?;
    if row.try_get::<i64, _>("keys")? >= i64::from(max_keys) {
        return Ok(Err(NoKey::TooMany(max_keys)));
    }
    let inserted = query(
        "insert into access_key (key_id, secret_sha256, name, scopes, models, created_at, expires_at)
         values (?, ?, ?, ?, ?, ?, ?) on conflict (key_id) do nothing
         returning access_key_id, key_id, name, scopes, models, created_at, expires_at, revoked_at",
    )
    .bind(issued.key_id.to_string())
    .bind(&issued.secret_sha256[..])
    .bind(wish.name.as_deref())
    .bind(serde_json::to_string(&wish.scopes).expect("words"))
    .bind(wish.models.as_ref().map(|models| serde_json::to_string(models).expect("names")))
    .bind(stored_time(now))
    .bind(wish.expires_at.map(stored_time))
    .fetch_optional(&mut **transaction)
    .await?;
    match &inserted {
        Some(row) => Ok(Ok(key_from(row)?)),
        None => Ok(Err(NoKey::Known(issued.key_id))),
    }
}

/// Ends a key at once. The last active admin key is only ended when that is meant (`force`): without one, keys are managed
/// with the command line on the server's machine alone.
///
/// # Errors
/// When the database cannot be written.
pub async fn revoke(
    transaction: &mut WriteTransaction,
    key_id: KeyId,
    force: bool,
    now: Timestamp,
) -> Result<Revoked, StoreError> {
    transaction.is_for(Purpose::KeyRevoked);
    let row =
        query(select_key!("where key_id = ?")).bind(key_id.to_string()).fetch_optional(&mut **transaction).await?;
    let Some(row) = row else { return Ok(Revoked::Unknown) };
    let key = key_from(&row)?;
    if key.state(now) == KeyState::Revoked {
        return Ok(Revoked::Done(key));
    }
    if !force && active_admins(transaction, now).await? == [key_id] {
        return Ok(Revoked::LastAdmin);
    }
    query("update access_key set revoked_at = ? where access_key_id = ?")
        .bind(stored_time(now))
        .bind(row.try_get::<i64, _>("access_key_id")?)
        .execute(&mut **transaction)
        .await?;
    Ok(Revoked::Done(Key { revoked_at: Some(now), ..key }))
}

/// Whether a key may manage keys. Without one they are managed by whoever has the database's file.
///
/// # Errors
/// When the database cannot be read.
pub async fn admin_is_active(connection: &mut SqliteConnection, now: Timestamp) -> Result<bool, StoreError> {
    Ok(!active_admins(connection, now).await?.is_empty())
}

/// Keys that may manage keys.
async fn active_admins(connection: &mut SqliteConnection, now: Timestamp) -> Result<Vec<KeyId>, StoreError> {
    let rows = query(select_key!("where revoked_at is null order by access_key_id")).fetch_all(connection).await?;
    let mut admins = Vec::new();
    for row in &rows {
        let key = key_from(row)?;
        if key.scopes.allow(Scope::Admin) && key.state(now) == KeyState::Active {
            admins.push(key.key_id);
        }
    }
    Ok(admins)
}

#[cfg(test)]
#[path = "keys_tests.rs"]
mod tests;
