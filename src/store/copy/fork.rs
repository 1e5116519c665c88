//! A model that begins where another one's version is.

use jiff::Timestamp;
use sqlx::query;

use super::{Chosen, NewModel, begin, copy};
use crate::lineage::{Model, ModelName, ModelSettings};
use crate::store::column::stored_time;
use crate::store::history::{self, Action, Change};
use crate::store::pointers::Pointers;
use crate::store::{Purpose, StoreError, WriteTransaction, audit, model, prune, version};

/// A fork that is wished for.
#[derive(Debug, Clone, Copy)]
pub struct Fork<'a> {
    /// The new model.
    pub name: &'a ModelName,
    /// The model that it comes from.
    pub of: &'a Model,
    /// The version there that will be its head, and live.
    pub version: i64,
    /// The new model's settings.
    pub settings: &'a ModelSettings,
}

/// Why there is no fork.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ForkRefused {
    /// The name is taken.
    NameTaken,
    /// The model has no such version.
    UnknownVersion,
    /// The version's weights were not kept.
    Pruned,
}

impl Fork<'_> {
    /// Makes it: the version and its parents under their numbers, what is kept of their regimes, and the tasks, batches and
    /// events that they learned from. What becomes of either model from then on is nothing to the other.
    ///
    /// # Errors
    /// When the database cannot be written, or what was to be copied is not what was written.
    pub async fn make(
        &self,
        transaction: &mut WriteTransaction,
        now: Timestamp,
    ) -> Result<Result<Model, ForkRefused>, StoreError> {
        transaction.is_for(Purpose::ModelForked);
        let (of, at) = (self.of.model_id, self.version);
        let taken = query("select 1 from model where name = ?").bind(self.name.as_str());
        if taken.fetch_optional(&mut **transaction).await?.is_some() {
            return Ok(Err(ForkRefused::NameTaken));
        }
        if !version::exists(transaction, of, at).await? {
            return Ok(Err(ForkRefused::UnknownVersion));
        }
        if prune::is_pruned(transaction, of, at).await? {
            return Ok(Err(ForkRefused::Pruned));
        }
        let new = NewModel {
            name: self.name,
            method: self.of.method.as_str(),
            settings: &serde_json::to_string(self.settings).expect("settings are plain data"),
            live: Some(at),
            head: Some(at),
            paused: false,
            created_at: &stored_time(now),
        };
        let from = format!("{}, version {at}", self.of.name);
        audit::copies(transaction, "model.fork", &from).await?;
        begin(transaction, "main").await?;
        let model_id = copy(transaction, of, Chosen::Line(at), &new).await?;
        let change = Change {
            model_id,
            action: Action::Promote,
            before: &Pointers { live: None, head: None, revision: 1 },
            after: &Pointers { live: Some(at), head: Some(at), revision: 1 },
            reason: &format!("forked from {from}"),
            report: None,
        };
        history::write(transaction, &change, now).await?;
        Ok(Ok(model::get(transaction, model_id).await?))
    }
}
