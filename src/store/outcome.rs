//! How a task ends. Each way is one transaction of the caller's; a task that ended before is left alone.

use jiff::Timestamp;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, query};

use super::array::{stored_floats, stored_integers};
use super::column::{sha256, stored_time};
use super::history::{self, Change};
use super::pointers::{self, Pointers};
use super::{Purpose, StoreError, WriteTransaction, seal, taint};
use crate::consolidation::{Method, RegimeMemory};
use crate::lineage::{ModelSettings, Promotion, PromotionDecision, RegimeEvaluation, StrengthSearch, TaskError};

/// What a finished task has to write.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The model's method.
    pub method: Method,
    /// Resolved: the model's with the task's overrides.
    pub settings: ModelSettings,
    /// The strength used; none where unused.
    pub strength: Option<f64>,
    /// The number in the formula; none where unused.
    pub lambda: Option<f64>,
    /// How the strength was found; none where it was not searched.
    pub strength_search: Option<StrengthSearch>,
    /// Name of the arithmetic.
    pub kernel: String,
    /// How many events were learned.
    pub train_events: u64,
    /// Over the sorted digests of these.
    pub events_sha256: [u8; 32],
    /// Standardisation.
    pub scaling: serde_json::Value,
    /// Importance in short, per layer; null where none is kept.
    pub importance: serde_json::Value,
    /// One flat vector.
    pub weights: Vec<f32>,
    /// What to keep of the regime learned.
    pub memory: Option<RegimeMemory>,
    /// The regime's new test events.
    pub reservoir: Vec<i64>,
    /// Every regime of the line, in the order first learned.
    pub regimes: Vec<OutcomeRegime>,
    /// What the policy decided.
    pub promotion: Promotion,
    /// The version that was live when it decided.
    pub judged_against: Option<i64>,
}

/// One regime of the line, after the task.
#[derive(Debug, Clone)]
pub struct OutcomeRegime {
    /// How the new version drives in it. Its `learned_version` is not looked at when `shared` is none.
    pub evaluation: RegimeEvaluation,
    /// Anchor and reservoir as the parent has them; none for the regime just learned.
    pub shared: Option<(Option<i64>, i64)>,
}

/// What a finished task wrote.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Finished {
    /// The new version, now the head.
    pub version: i64,
    /// Whether it is live.
    pub live: bool,
}

/// Why a finished task may not write its version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Overtaken {
    /// It was cancelled, by a rollback for one.
    #[error("the task is not running any more")]
    Ended,
    /// Somebody asked to cancel it.
    #[error("somebody asked to cancel the task")]
    CancelRequested,
    /// Another version went live since the policy decided; it has to decide again.
    #[error("another version went live")]
    LiveMoved,
}

/// Writes the version, what is remembered and how it drives; ends the task; moves the head, and live when promoted.
///
/// # Errors
/// When the database cannot be written.
pub async fn succeeded(
    transaction: &mut WriteTransaction,
    task_id: i64,
    outcome: &Outcome,
    now: Timestamp,
) -> Result<Result<Finished, Overtaken>, StoreError> {
    transaction.is_for(Purpose::TaskSucceeded);
    let task = query("select * from task where task_id = ?").bind(task_id).fetch_one(&mut **transaction).await?;
    let model_id: i64 = task.try_get("model_id")?;
    let before = pointers::read(transaction, model_id).await?;
    if let Some(overtaken) = overtaken(&task, &before, outcome)? {
        return Ok(Err(overtaken));
    }
    let place = Place {
        model_id,
        task_id: Some(task_id),
        parent: task.try_get("parent_version")?,
        stage: task.try_get("stage")?,
        regime: task.try_get("regime")?,
    };
    let version = insert_version(transaction, &place, outcome, now).await?;
    insert_regimes(transaction, model_id, version, outcome).await?;
    seal::seal(transaction).await?;
    taint::inherit(transaction, model_id, version, now).await?;
    query("update task set state = 'succeeded', version = ?, ended_at = ? where task_id = ?")
        .bind(version)
        .bind(stored_time(now))
        .bind(task_id)
        .execute(&mut **transaction)
        .await?;
    release(transaction, task_id, "learned").await?;
    let live = outcome.promotion.decision == PromotionDecision::Promoted;
    let after = Pointers { live: if live { Some(version) } else { before.live }, head: Some(version), ..before };
    pointers::write(transaction, model_id, &after).await?;
    if live {
        let change = Change {
            model_id,
            action: history::Action::Policy,
            before: &before,
            after: &after,
            reason: &outcome.promotion.reason,
            report: None,
        };
        history::write(transaction, &change, now).await?;
    }
    Ok(Ok(Finished { version, live }))
}

fn overtaken(task: &SqliteRow, before: &Pointers, outcome: &Outcome) -> Result<Option<Overtaken>, StoreError> {
    let running = task.try_get::<&str, _>("state")? == "running";
    let parent: Option<i64> = task.try_get("parent_version")?;
    if !running || parent != before.head {
        return Ok(Some(Overtaken::Ended));
    }
    if task.try_get::<i64, _>("cancel_requested")? == 1 {
        return Ok(Some(Overtaken::CancelRequested));
    }
    Ok((outcome.judged_against != before.live).then_some(Overtaken::LiveMoved))
}

/// Where a new version stands.
pub(super) struct Place<'a> {
    pub(super) model_id: i64,
    /// The task that made it.
    pub(super) task_id: Option<i64>,
    pub(super) parent: Option<i64>,
    pub(super) stage: i64,
    /// The regime that its stage learned.
    pub(super) regime: &'a str,
}

/// Writes a version's row and its weights; gives its number.
pub(super) async fn insert_version(
    transaction: &mut WriteTransaction,
    place: &Place<'_>,
    outcome: &Outcome,
    now: Timestamp,
) -> Result<i64, StoreError> {
    let model_id = place.model_id;
    let weights = stored_floats(&outcome.weights);
    let row = query(
        "insert into version (model_id, version, task_id, parent, stage, regime, method, settings, seed, strength,
             lambda, kernel, train_events, events_sha256, scaling, importance, weights_sha256, promotion, created_at,
             strength_search)
         values (?1, 1 + coalesce((select max(version) from version where model_id = ?1), 0), ?2, ?3, ?4, ?5, ?6, ?7, ?8,
             ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?18, ?19)
         returning version",
    )
    .bind(model_id)
    .bind(place.task_id)
    .bind(place.parent)
    .bind(place.stage)
    .bind(place.regime)
    .bind(outcome.method.as_str())
    .bind(plain(&outcome.settings))
    .bind(outcome.settings.seed.cast_signed())
    .bind(outcome.strength)
    .bind(outcome.lambda)
    .bind(&outcome.kernel)
    .bind(signed(outcome.train_events)?)
    .bind(&outcome.events_sha256[..])
    .bind(plain(&outcome.scaling))
    .bind((!outcome.importance.is_null()).then(|| plain(&outcome.importance)))
    .bind(&sha256(&[&weights])[..])
    .bind(plain(&outcome.promotion))
    .bind(stored_time(now))
    .bind(outcome.strength_search.as_ref().map(plain))
    .fetch_one(&mut **transaction)
    .await?;
    let version = row.try_get("version")?;
    query("insert into weights (model_id, version, weights) values (?, ?, ?)")
        .bind(model_id)
        .bind(version)
        .bind(weights)
        .execute(&mut **transaction)
        .await?;
    Ok(version)
}

fn plain(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("what a version keeps is plain data")
}

fn signed(number: u64) -> Result<i64, StoreError> {
    i64::try_from(number).map_err(|_| StoreError::malformed("count", format!("{number} is out of range")))
}

async fn insert_regimes(
    transaction: &mut WriteTransaction,
    model_id: i64,
    version: i64,
    outcome: &Outcome,
) -> Result<(), StoreError> {
    let anchor_id = match &outcome.memory {
        Some(memory) => Some(insert_anchor(transaction, model_id, memory).await?),
        None => None,
    };
    let reservoir_id = insert_reservoir(transaction, model_id, &outcome.reservoir).await?;
    insert_evaluations(transaction, model_id, version, &outcome.regimes, (anchor_id, reservoir_id)).await
}

/// Writes the test events of a regime; gives their id.
pub(super) async fn insert_reservoir(
    transaction: &mut WriteTransaction,
    model_id: i64,
    events: &[i64],
) -> Result<i64, StoreError> {
    let row = query("insert into reservoir (model_id, event_ids) values (?, ?) returning reservoir_id")
        .bind(model_id)
        .bind(stored_integers(events))
        .fetch_one(&mut **transaction)
        .await?;
    Ok(row.try_get("reservoir_id")?)
}

/// Writes how a version drives in every regime of its line. Those that share no anchor and reservoir have `own`.
pub(super) async fn insert_evaluations(
    transaction: &mut WriteTransaction,
    model_id: i64,
    version: i64,
    regimes: &[OutcomeRegime],
    own: (Option<i64>, i64),
) -> Result<(), StoreError> {
    let (anchor_id, reservoir_id) = own;
    for (position, regime) in (0_i64..).zip(regimes) {
        let (anchor_id, reservoir_id, learned_version) = match regime.shared {
            Some((anchor_id, reservoir_id)) => (anchor_id, reservoir_id, regime.evaluation.learned_version),
            None => (anchor_id, reservoir_id, version),
        };
        let RegimeEvaluation { measures, served, before, .. } = &regime.evaluation;
        query(
            "insert into version_regime (model_id, version, position, regime, learned_stage, learned_version, anchor_id,
                 reservoir_id, test_events, test_steps, spacing_mse, speed_mse, collisions, before_spacing_mse,
                 before_speed_mse, before_collisions, diagonal_spacing_mse, best_spacing_mse, served_spacing_mse,
                 served_speed_mse, served_collisions, served_acted_steps, served_held_steps)
             values (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(model_id)
        .bind(version)
        .bind(position)
        .bind(regime.evaluation.regime.as_str())
        .bind(regime.evaluation.learned_stage)
        .bind(learned_version)
        .bind(anchor_id)
        .bind(reservoir_id)
        .bind(measures.map_or(0, |m| m.events))
        .bind(signed(measures.map_or(0, |m| m.steps))?)
        .bind(measures.map(|m| m.spacing_mse))
        .bind(measures.map(|m| m.speed_mse))
        .bind(measures.map(|m| m.collisions))
        .bind(before.map(|m| m.spacing_mse))
        .bind(before.map(|m| m.speed_mse))
        .bind(before.map(|m| m.collisions))
        .bind(regime.evaluation.diagonal_spacing_mse)
        .bind(regime.evaluation.best_spacing_mse)
        .bind(served.map(|m| m.spacing_mse))
        .bind(served.map(|m| m.speed_mse))
        .bind(served.map(|m| m.collisions))
        .bind(served.map(|m| signed(m.acted_steps)).transpose()?)
        .bind(served.map(|m| signed(m.held_steps)).transpose()?)
        .execute(&mut **transaction)
        .await?;
    }
    Ok(())
}

/// Writes what is kept of a regime; gives its id.
pub(super) async fn insert_anchor(
    transaction: &mut WriteTransaction,
    model_id: i64,
    memory: &RegimeMemory,
) -> Result<i64, StoreError> {
    let (importance, weights) = (stored_floats(&memory.importance), stored_floats(&memory.anchor));
    let digest = sha256(&[&importance, &weights]);
    let row = query(
        "insert into anchor (model_id, samples, importance, weights, anchor_sha256) values (?, ?, ?, ?, ?)
         returning anchor_id",
    )
    .bind(model_id)
    .bind(signed(memory.samples)?)
    .bind(importance)
    .bind(weights)
    .bind(&digest[..])
    .fetch_one(&mut **transaction)
    .await?;
    Ok(row.try_get("anchor_id")?)
}

/// Ends a task that could not learn; its events are held. `false` when it had ended before.
///
/// # Errors
/// When the database cannot be written.
pub async fn failed(
    transaction: &mut WriteTransaction,
    task_id: i64,
    error: &TaskError,
    now: Timestamp,
) -> Result<bool, StoreError> {
    transaction.is_for(Purpose::TaskFailed);
    end_without_version(transaction, task_id, "failed", Some(error), now, "held").await
}

/// Ends a task that nobody wants any more; its events are set aside. `false` when it had ended before.
///
/// # Errors
/// When the database cannot be written.
pub async fn cancelled(transaction: &mut WriteTransaction, task_id: i64, now: Timestamp) -> Result<bool, StoreError> {
    transaction.is_for(Purpose::TaskCancelled);
    end_without_version(transaction, task_id, "cancelled", None, now, "set_aside").await
}

async fn end_without_version(
    transaction: &mut WriteTransaction,
    task_id: i64,
    state: &'static str,
    error: Option<&TaskError>,
    now: Timestamp,
    events: &'static str,
) -> Result<bool, StoreError> {
    let ended = query(
        "update task set state = ?, error_code = ?, error_detail = ?, ended_at = ?
         where task_id = ? and state in ('queued', 'running')",
    )
    .bind(state)
    .bind(error.map(|e| e.code.as_str()))
    .bind(error.map(|e| e.detail.as_str()))
    .bind(stored_time(now))
    .bind(task_id)
    .execute(&mut **transaction)
    .await?;
    if ended.rows_affected() == 0 {
        return Ok(false);
    }
    release(transaction, task_id, events).await?;
    pointers::learned_again(transaction, task_id).await?;
    Ok(true)
}

/// Gives back the events a task claimed, in the state its end leaves them in, and drops its checkpoint.
async fn release(transaction: &mut WriteTransaction, task_id: i64, state: &'static str) -> Result<(), StoreError> {
    query(
        "update event set state = ?
         where state = 'claimed' and event_id in (select event_id from task_event where task_id = ?)",
    )
    .bind(state)
    .bind(task_id)
    .execute(&mut **transaction)
    .await?;
    query("delete from checkpoint where task_id = ?").bind(task_id).execute(&mut **transaction).await?;
    Ok(())
}
