//! The audit log: in whose name a change is made, and what was changed. What is written into it is said in `audit.sql`, and
//! by no other code: triggers see every change, whoever makes it.

use jiff::Timestamp;
use serde_json::Value;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{Row, query, raw_sql};

use super::column::{json, time};
use super::{Store, StoreError, WriteTransaction};

/// In whose name a change is made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Actor {
    /// The id of a key; else `local`, whoever has the server or its file to himself, or `server`, which acts by itself.
    pub name: String,
    /// The request that asks for it.
    pub request_id: Option<String>,
}

impl Actor {
    /// Whoever has the database's file, or a server that has no keys.
    #[must_use]
    pub fn local() -> Self {
        Self { name: "local".to_owned(), request_id: None }
    }

    /// The server itself: schedules, ends of tasks.
    #[must_use]
    pub fn server() -> Self {
        Self { name: "server".to_owned(), request_id: None }
    }
}

/// A change that was made.
#[derive(Debug, Clone, PartialEq)]
pub struct AuditEntry {
    /// Its id; ascending in time.
    pub audit_id: i64,
    /// When.
    pub at: Timestamp,
    /// Who.
    pub actor: String,
    /// What was done: a noun and a verb, `batch.upload`.
    pub action: String,
    /// The model it was done to.
    pub model: Option<String>,
    /// Id on the wire of what it was done to.
    pub resource: Option<String>,
    /// The request that asked for it.
    pub request_id: Option<String>,
    /// More, by action.
    pub detail: Value,
}

/// Lets a connection that is to write note what it changes.
pub(super) async fn prepare(connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    raw_sql(include_str!("audit.sql")).execute(connection).await.map(drop)
}

/// Says in whose name the changes of this transaction are made.
pub(super) async fn act(transaction: &mut WriteTransaction, actor: &Actor) -> Result<(), StoreError> {
    query("update acting set actor = ?, request_id = ?, copied_as = null, copied_from = null")
        .bind(&actor.name)
        .bind(actor.request_id.as_deref())
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

/// Says that what is written from here on in this transaction is a copy, noted as one change of this name: what it is a copy
/// of was noted when it was made.
pub(super) async fn copies(transaction: &mut WriteTransaction, action: &str, from: &str) -> Result<(), StoreError> {
    query("update acting set copied_as = ?, copied_from = ?")
        .bind(action)
        .bind(from)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

/// Sets how many entries are kept.
pub(super) async fn bound(transaction: &mut WriteTransaction, entries: u32) -> Result<(), StoreError> {
    query("update audit_bound set entries = ?1 where entries <> ?1").bind(entries).execute(&mut **transaction).await?;
    Ok(())
}

/// `select` of every column of [`entry_from`], with what follows `where`.
macro_rules! select_audit {
    ($rest:literal) => {
        concat!(
            "select a.audit_id, a.at, a.actor, a.action, m.name as model, a.resource, a.request_id, a.detail ",
            "from audit a left join model m on m.model_id = a.model_id where ",
            $rest
        )
    };
}

fn entry_from(row: &SqliteRow) -> Result<AuditEntry, StoreError> {
    Ok(AuditEntry {
        audit_id: row.try_get("audit_id")?,
        at: time(row, "at")?,
        actor: row.try_get("actor")?,
        action: row.try_get("action")?,
        model: row.try_get("model")?,
        resource: row.try_get("resource")?,
        request_id: row.try_get("request_id")?,
        detail: json(row, "detail")?,
    })
}

impl Store {
    /// At most `limit` entries with ids above `after`, ascending: of one model, or all.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn audit(&self, model_id: Option<i64>, after: i64, limit: u32) -> Result<Vec<AuditEntry>, StoreError> {
        let rows = match model_id {
            None => query(select_audit!("a.audit_id > ? order by a.audit_id limit ?")),
            Some(model_id) => {
                query(select_audit!("a.model_id = ? and a.audit_id > ? order by a.audit_id limit ?")).bind(model_id)
            }
        };
        let rows = rows.bind(after).bind(limit).fetch_all(&self.readers).await?;
        rows.iter().map(entry_from).collect()
    }
}

#[cfg(test)]
#[path = "audit_tests.rs"]
mod tests;
