//! Who served when and why.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use sqlx::{Row, query};

use super::column::{json, stored_time, time, word};
use super::pointers::Pointers;
use super::{Store, StoreError, WriteTransaction};
use crate::lineage::ReplayReport;

/// What moved a pointer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// A person moved live.
    Promote,
    /// A person moved live and head back.
    Rollback,
    /// The promotion policy moved live.
    Policy,
    /// A person retracted what the head's line had learned: the head moved to before that.
    Retract,
    /// A replay ended.
    Replay,
}

impl Action {
    fn as_str(self) -> &'static str {
        match self {
            Self::Promote => "promote",
            Self::Rollback => "rollback",
            Self::Policy => "policy",
            Self::Retract => "retract",
            Self::Replay => "replay",
        }
    }
}

/// One entry.
#[derive(Debug, Clone, PartialEq)]
pub struct HistoryEntry {
    /// Its id; ascending in time.
    pub history_id: i64,
    /// When.
    pub at: Timestamp,
    /// What moved.
    pub action: Action,
    /// Live before.
    pub from_live: Option<i64>,
    /// Live after.
    pub live: Option<i64>,
    /// Head before.
    pub from_head: Option<i64>,
    /// Head after.
    pub head: Option<i64>,
    /// Why.
    pub reason: String,
    /// Who.
    pub actor: String,
    /// Of a replay: what came of it.
    pub report: Option<ReplayReport>,
}

/// A move to be written.
pub(super) struct Change<'a> {
    pub(super) model_id: i64,
    pub(super) action: Action,
    pub(super) before: &'a Pointers,
    pub(super) after: &'a Pointers,
    pub(super) reason: &'a str,
    pub(super) report: Option<&'a ReplayReport>,
}

/// Writes an entry and gives its id. What the policy decides is its own; the rest is whose the transaction is.
pub(super) async fn write(
    transaction: &mut WriteTransaction,
    change: &Change<'_>,
    now: Timestamp,
) -> Result<i64, StoreError> {
    let actor = match change.action {
        Action::Policy | Action::Replay => "policy".to_owned(),
        Action::Promote | Action::Rollback | Action::Retract => transaction.actor(),
    };
    let row = query(
        "insert into history (model_id, at, action, from_live, live, from_head, head, reason, actor, report)
         values (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) returning history_id",
    )
    .bind(change.model_id)
    .bind(stored_time(now))
    .bind(change.action.as_str())
    .bind(change.before.live)
    .bind(change.after.live)
    .bind(change.before.head)
    .bind(change.after.head)
    .bind(change.reason)
    .bind(actor)
    .bind(change.report.map(|report| serde_json::to_string(report).expect("a report is plain data")))
    .fetch_one(&mut **transaction)
    .await?;
    Ok(row.try_get("history_id")?)
}

impl Store {
    /// At most `limit` entries of the model with ids above `after`, ascending.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn history(&self, model_id: i64, after: i64, limit: u32) -> Result<Vec<HistoryEntry>, StoreError> {
        let rows = query("select * from history where model_id = ? and history_id > ? order by history_id limit ?")
            .bind(model_id)
            .bind(after)
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        rows.iter()
            .map(|row| {
                Ok(HistoryEntry {
                    history_id: row.try_get("history_id")?,
                    at: time(row, "at")?,
                    action: word(row, "action")?,
                    from_live: row.try_get("from_live")?,
                    live: row.try_get("live")?,
                    from_head: row.try_get("from_head")?,
                    head: row.try_get("head")?,
                    reason: row.try_get("reason")?,
                    actor: row.try_get("actor")?,
                    report: json(row, "report")?,
                })
            })
            .collect()
    }
}
