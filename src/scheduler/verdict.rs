//! How a new version drives, and what the promotion policy makes of it.

use std::sync::Arc;

use super::error::JobError;
use super::handle::Scheduler;
use super::importance;
use super::stage::{Known, Stage, at_step};
use crate::car_following::Event;
use crate::driver::{DriverShape, Scaling};
use crate::lineage::{
    ModelSettings, Promotion, PromotionDecision, PromotionPolicy, RegimeComparison, RegimeEvaluation, ServedMeasures,
    TestMeasures,
};
use crate::store::LineRegime;
use crate::store::new_version::{NewRegime, NewVersion};
use crate::store::outcome::Outcome;
use crate::training::Learned;

/// A version about to be written, and the test events of the regime it learned.
pub(super) struct Verdict {
    pub(super) outcome: Outcome,
    fresh: Arc<Vec<Event>>,
}

/// A network to be driven over test events.
#[derive(Clone)]
pub(super) struct Network {
    shape: DriverShape,
    scaling: Scaling,
    weights: Arc<Vec<f32>>,
}

impl Network {
    pub(super) fn of(known: &Known) -> Self {
        Self { shape: known.version.settings.shape(), scaling: known.scaling, weights: Arc::new(known.weights.clone()) }
    }

    /// Closed-loop measures; none without test events that are long enough.
    pub(super) async fn drive(
        &self,
        scheduler: &Scheduler,
        events: &Arc<Vec<Event>>,
    ) -> Result<Option<TestMeasures>, JobError> {
        if events.is_empty() {
            return Ok(None);
        }
        let (network, events) = (self.clone(), Arc::clone(events));
        let errors = scheduler.compute(move |inner| {
            inner.learner.evaluate(network.shape, &network.scaling, &network.weights, &events, &inner.workers)
        });
        Ok(TestMeasures::of(&errors.await?))
    }

    /// The same of what is served, when it is bounded.
    async fn serve(
        &self,
        scheduler: &Scheduler,
        settings: &ModelSettings,
        events: &Arc<Vec<Event>>,
    ) -> Result<Option<ServedMeasures>, JobError> {
        if events.is_empty() || !settings.envelope {
            return Ok(None);
        }
        let (network, events) = (self.clone(), Arc::clone(events));
        let served = scheduler.compute(move |inner| {
            inner.learner.evaluate_served(network.shape, &network.scaling, &network.weights, &events, &inner.workers)
        });
        Ok(ServedMeasures::of(&served.await?))
    }
}

/// Drives the new version on the test events of every regime of its line, and the parent on those of the new one.
pub(super) async fn measure(scheduler: &Scheduler, stage: &Stage, learned: Learned) -> Result<Verdict, JobError> {
    let new =
        Network { shape: stage.settings.shape(), scaling: learned.scaling, weights: Arc::new(learned.weights.clone()) };
    let known = stage.parent.as_ref().map_or(&[][..], |parent| &parent.regimes);
    let old = known.iter().find(|regime| regime.evaluation.regime == stage.task.regime);
    let store = &scheduler.0.store;
    let limit = stage.settings.test_reservoir;
    let reservoir = store.refreshed_reservoir(old.map(|old| old.reservoir_id), stage.task.task_id, limit).await?;
    let reservoir_ids = reservoir.iter().map(|stored| stored.event_id).collect();
    let fresh = Arc::new(at_step(reservoir, stage.settings.dt_s));
    let before = match &stage.parent {
        Some(parent) => Network::of(parent).drive(scheduler, &fresh).await?,
        None => None,
    };
    let mut learned_now = learned_now(stage, new.drive(scheduler, &fresh).await?, before);
    learned_now.evaluation.served = new.serve(scheduler, &stage.settings, &fresh).await?;
    let mut regimes = Vec::with_capacity(known.len() + 1);
    for regime in known {
        if regime.evaluation.regime == stage.task.regime {
            regimes.push(learned_now.clone());
        } else {
            let events = Arc::new(at_step(store.reservoir(regime.reservoir_id).await?, stage.settings.dt_s));
            let mut known = still_known(regime, new.drive(scheduler, &events).await?);
            known.evaluation.served = new.serve(scheduler, &stage.settings, &events).await?;
            regimes.push(known);
        }
    }
    if old.is_none() {
        regimes.push(learned_now);
    }
    Ok(Verdict { outcome: outcome(stage, learned, reservoir_ids, regimes), fresh })
}

fn learned_now(stage: &Stage, measures: Option<TestMeasures>, before: Option<TestMeasures>) -> NewRegime {
    let evaluation = RegimeEvaluation {
        regime: stage.task.regime.clone(),
        learned_stage: stage.number,
        learned_version: 0,
        measures,
        served: None,
        before,
        diagonal_spacing_mse: measures.map(|m| m.spacing_mse),
        best_spacing_mse: None,
    };
    NewRegime { evaluation, shared: None }
}

/// A regime that an earlier stage learned. The best so far is the parent's best, or the parent itself.
fn still_known(at_parent: &LineRegime, measures: Option<TestMeasures>) -> NewRegime {
    let parent = &at_parent.evaluation;
    let best = parent.best_spacing_mse.into_iter().chain(parent.measures.map(|m| m.spacing_mse)).reduce(f64::min);
    NewRegime {
        evaluation: RegimeEvaluation { measures, served: None, before: None, best_spacing_mse: best, ..parent.clone() },
        shared: Some((at_parent.anchor_id, at_parent.reservoir_id)),
    }
}

fn outcome(stage: &Stage, learned: Learned, reservoir: Vec<i64>, regimes: Vec<NewRegime>) -> Outcome {
    Outcome {
        version: NewVersion {
            method: stage.model.method,
            settings: stage.settings.clone(),
            strength: learned.strength,
            lambda: learned.lambda,
            strength_search: None,
            kernel: learned.kernel,
            train_events: stage.train.len() as u64,
            events_sha256: stage.events_sha256,
            scaling: serde_json::to_value(learned.scaling).expect("a scaling is plain data"),
            importance: importance::summary(stage.settings.shape(), learned.memory.as_ref()),
            weights: learned.weights,
        },
        memory: learned.memory,
        reservoir,
        regimes,
        promotion: Promotion {
            policy: stage.settings.promotion,
            decision: PromotionDecision::Kept,
            reason: String::new(),
        },
        judged_against: None,
    }
}

/// Why no policy lets the new version serve by itself, where none does.
fn kept_anyway(stage: &Stage) -> Option<String> {
    if let Some(replay) = stage.task.part_of {
        return Some(format!("a part of replay t{replay}, which decides about its last version"));
    }
    let parent = stage.parent.as_ref().filter(|parent| parent.version.tainted)?;
    Some(format!("it continues version {}, which has learned what was retracted", parent.version.version))
}

impl Verdict {
    /// Lets the policy decide against the version that is live now.
    pub(super) async fn decide(
        &mut self,
        scheduler: &Scheduler,
        stage: &Stage,
        live: Option<i64>,
    ) -> Result<(), JobError> {
        let policy = stage.settings.promotion;
        self.outcome.judged_against = live;
        if let Some(reason) = kept_anyway(stage) {
            self.outcome.promotion = Promotion { policy, decision: PromotionDecision::Kept, reason };
            return Ok(());
        }
        let comparisons = match live {
            None => None,
            Some(_) if policy != PromotionPolicy::Gated => Some(Vec::new()),
            Some(live) => Some(self.comparisons(scheduler, stage, live).await?),
        };
        self.outcome.promotion = policy.decide(comparisons.as_deref(), stage.settings.promotion_error_ratio);
        Ok(())
    }

    /// New and live version on the same test events, regime by regime; what is known already is not driven again.
    async fn comparisons(
        &self,
        scheduler: &Scheduler,
        stage: &Stage,
        live: i64,
    ) -> Result<Vec<RegimeComparison>, JobError> {
        let is_parent = stage.task.parent == Some(live);
        let other =
            if is_parent { None } else { Some(Known::load(&scheduler.0.store, stage.model.model_id, live).await?) };
        let served =
            other.as_ref().or(stage.parent.as_ref()).map(|known| (Network::of(known), known.regimes.as_slice()));
        let mut comparisons = Vec::new();
        for regime in &self.outcome.regimes {
            let (Some(new), Some((network, known))) = (regime.evaluation.measures, &served) else { continue };
            let name = &regime.evaluation.regime;
            let measured = match regime.shared {
                None if is_parent => regime.evaluation.before,
                None => network.drive(scheduler, &self.fresh).await?,
                Some((_, reservoir_id)) => {
                    let same = |one: &&LineRegime| one.evaluation.regime == *name && one.reservoir_id == reservoir_id;
                    if let Some(known) = known.iter().find(same) {
                        known.evaluation.measures
                    } else {
                        let events = scheduler.0.store.reservoir(reservoir_id).await?;
                        network.drive(scheduler, &Arc::new(at_step(events, stage.settings.dt_s))).await?
                    }
                }
            };
            comparisons.extend(measured.map(|live| RegimeComparison { regime: name.clone(), new, live }));
        }
        Ok(comparisons)
    }
}
