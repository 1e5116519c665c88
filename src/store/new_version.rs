//! The rows of a version that is written: by a task that learned it, or out of a file.

use jiff::Timestamp;
use sqlx::{Row, query};

use super::array::{stored_floats, stored_integers};
use super::column::{sha256, stored_time};
use super::history::{self, Action, Change};
use super::pointers::{self, Pointers};
use super::{StoreError, WriteTransaction};
use crate::consolidation::{Method, RegimeMemory};
use crate::lineage::{ModelSettings, Promotion, PromotionDecision, RegimeEvaluation, StrengthSearch};

/// What a version is, wherever it comes from.
#[derive(Debug, Clone)]
pub struct NewVersion {
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
}

/// One regime of its line.
#[derive(Debug, Clone)]
pub struct NewRegime {
    /// How the new version drives in it. Its `learned_version` is not looked at when `shared` is none.
    pub evaluation: RegimeEvaluation,
    /// Anchor and reservoir as the parent has them; none for the regime just learned.
    pub shared: Option<(Option<i64>, i64)>,
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
pub(super) async fn insert(
    transaction: &mut WriteTransaction,
    place: &Place<'_>,
    new: &NewVersion,
    promotion: &Promotion,
    now: Timestamp,
) -> Result<i64, StoreError> {
    let model_id = place.model_id;
    let weights = stored_floats(&new.weights);
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
    .bind(new.method.as_str())
    .bind(plain(&new.settings))
    .bind(new.settings.seed.cast_signed())
    .bind(new.strength)
    .bind(new.lambda)
    .bind(&new.kernel)
    .bind(signed(new.train_events)?)
    .bind(&new.events_sha256[..])
    .bind(plain(&new.scaling))
    .bind((!new.importance.is_null()).then(|| plain(&new.importance)))
    .bind(&sha256(&[&weights])[..])
    .bind(plain(promotion))
    .bind(stored_time(now))
    .bind(new.strength_search.as_ref().map(plain))
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

/// Makes a new version the head, and live when it was promoted; whether it was.
pub(super) async fn take_over(
    transaction: &mut WriteTransaction,
    model_id: i64,
    version: i64,
    promotion: &Promotion,
    before: &Pointers,
    now: Timestamp,
) -> Result<bool, StoreError> {
    let live = promotion.decision == PromotionDecision::Promoted;
    let after = Pointers { live: if live { Some(version) } else { before.live }, head: Some(version), ..*before };
    pointers::write(transaction, model_id, &after).await?;
    if live {
        let reason = &promotion.reason;
        let change = Change { model_id, action: Action::Policy, before, after: &after, reason, report: None };
        history::write(transaction, &change, now).await?;
    }
    Ok(live)
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
pub(super) async fn insert_regimes(
    transaction: &mut WriteTransaction,
    model_id: i64,
    version: i64,
    regimes: &[NewRegime],
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

fn plain(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("what a version keeps is plain data")
}

fn signed(number: u64) -> Result<i64, StoreError> {
    i64::try_from(number).map_err(|_| StoreError::malformed("count", format!("{number} is out of range")))
}
