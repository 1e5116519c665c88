//! A version that comes from elsewhere, with what consolidation keeps of its line and without its events.

use jiff::Timestamp;
use sqlx::query;

use super::new_version::{self, NewRegime, NewVersion, Place};
use super::pointers;
use super::{Purpose, StoreError, WriteTransaction, seal};
use crate::consolidation::RegimeMemory;
use crate::lineage::{Promotion, RegimeEvaluation, RegimeName};

/// What is written of a version that was not learned here.
#[derive(Debug, Clone)]
pub struct Import {
    /// Position on the line it had elsewhere, from 1.
    pub stage: u32,
    /// The regime that its stage learned.
    pub regime: RegimeName,
    /// What it is.
    pub version: NewVersion,
    /// Every regime of its line, in the order first learned.
    pub regimes: Vec<ImportedRegime>,
}

/// One regime of the line.
#[derive(Debug, Clone)]
pub struct ImportedRegime {
    /// Its name.
    pub regime: RegimeName,
    /// The last stage that learned it.
    pub stage: u32,
    /// What is kept of it; none where nothing is.
    pub memory: Option<RegimeMemory>,
}

/// A version that was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Imported {
    /// Its number; it is the head.
    pub version: i64,
    /// Whether it is live.
    pub live: bool,
}

/// A task is queued or running, and expects the head where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("tasks of the model are queued or running")]
pub struct Occupied;

/// Writes the version and what is kept of its line, without parent and task; moves the head to it, and live when `decide`, told
/// which version is live, promotes it. Events that only the line before had learned are set aside, as in a rollback.
///
/// # Errors
/// When the database cannot be written.
pub async fn import(
    transaction: &mut WriteTransaction,
    model_id: i64,
    import: Import,
    decide: impl FnOnce(Option<i64>) -> Promotion,
    now: Timestamp,
) -> Result<Result<Imported, Occupied>, StoreError> {
    transaction.is_for(Purpose::VersionImported);
    let active = query("select 1 from task where model_id = ? and state in ('queued', 'running') limit 1");
    if active.bind(model_id).fetch_optional(&mut **transaction).await?.is_some() {
        return Ok(Err(Occupied));
    }
    let before = pointers::read(transaction, model_id).await?;
    let promotion = decide(before.live);
    let place =
        Place { model_id, task_id: None, parent: None, stage: import.stage.into(), regime: import.regime.as_str() };
    let version = new_version::insert(transaction, &place, &import.version, &promotion, now).await?;
    insert_line(transaction, model_id, version, &import.regimes).await?;
    seal::seal(transaction).await?;
    let live = new_version::take_over(transaction, model_id, version, &promotion, &before, now).await?;
    pointers::settle_events(transaction, model_id).await?;
    Ok(Ok(Imported { version, live }))
}

/// The line's regimes, as this version's own: the versions that learned them are elsewhere, and so are their test events.
async fn insert_line(
    transaction: &mut WriteTransaction,
    model_id: i64,
    version: i64,
    regimes: &[ImportedRegime],
) -> Result<(), StoreError> {
    let no_events = new_version::insert_reservoir(transaction, model_id, &[]).await?;
    let mut rows = Vec::with_capacity(regimes.len());
    for ImportedRegime { regime, stage, memory } in regimes {
        let anchor = match memory {
            Some(memory) => Some(new_version::insert_anchor(transaction, model_id, memory).await?),
            None => None,
        };
        let evaluation = RegimeEvaluation {
            regime: regime.clone(),
            learned_stage: *stage,
            learned_version: version,
            measures: None,
            served: None,
            before: None,
            diagonal_spacing_mse: None,
            best_spacing_mse: None,
        };
        rows.push(NewRegime { evaluation, shared: Some((anchor, no_events)) });
    }
    new_version::insert_regimes(transaction, model_id, version, &rows, (None, no_events)).await
}
