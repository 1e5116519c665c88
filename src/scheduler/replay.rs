//! The end of a replay: how the head drives that never saw what was retracted, beside the one that had learned it, and what
//! is to serve.

use std::sync::Arc;

use super::error::JobError;
use super::handle::Scheduler;
use super::running::Running;
use super::stage::{Known, at_step};
use super::verdict::Network;
use crate::lineage::{
    Model, PromotionDecision, RegimeComparison, RegimeName, ReplayReport, ReplayedLive, ReplayedRegimes, Task,
    TestMeasures,
};
use crate::store::StoreError;
use crate::store::outcome::Overtaken;
use crate::store::replay::{self, Replay};

/// Measures, lets the policy decide about a live version that is tainted or older, and writes it all; tells the predictor.
pub(super) async fn conclude(scheduler: &Scheduler, task: &Task, running: &Running) -> Result<(), JobError> {
    let store = &scheduler.0.store;
    loop {
        let model = store.model_by_id(task.model_id).await?;
        let found = store.replay(task.model_id, task.task_id).await?;
        let report = report(scheduler, &model, found).await?;
        if running.stop.asked().is_some() {
            return Err(JobError::Stopped);
        }
        let mut transaction = store.begin().await?;
        match replay::ended(&mut transaction, task.task_id, &report, (scheduler.0.clock)()).await? {
            Ok(()) => {
                transaction.commit().await?;
                scheduler.0.predictor.refresh(task.model_id).await;
                tell(task, &report);
                return Ok(());
            }
            Err(Overtaken::LiveMoved) => {}
            Err(Overtaken::Ended | Overtaken::CancelRequested) => return Err(JobError::Stopped),
        }
    }
}

fn tell(task: &Task, report: &ReplayReport) {
    let ReplayReport { before, after, live, .. } = report;
    let task_id = task.task_id;
    tracing::info!(task_id, before, after, live = live.to, reason = live.reason, "a replay ended");
    if live.tainted {
        tracing::warn!(
            task_id,
            live = live.to,
            reason = live.reason,
            "the live version has learned what was retracted and still serves; promote another one"
        );
    }
}

async fn report(scheduler: &Scheduler, model: &Model, found: Replay) -> Result<ReplayReport, JobError> {
    let before = usable(scheduler, model, found.from_head).await?;
    let after = match model.head {
        Some(head) => Some(Known::load(&scheduler.0.store, model.model_id, head).await?),
        None => None,
    };
    let replayed = found.stages.iter().any(|stage| stage.replayed_as.is_some());
    let regimes = regimes(scheduler, model, before.as_ref(), after.as_ref()).await?;
    let live = live(scheduler, model, after.as_ref(), replayed).await?;
    Ok(ReplayReport { before: found.from_head, after: model.head, stages: found.stages, regimes, live })
}

/// A version to compare with; none where it is corrupt, as then there is nothing to compare.
async fn usable(scheduler: &Scheduler, model: &Model, version: Option<i64>) -> Result<Option<Known>, JobError> {
    let Some(version) = version else { return Ok(None) };
    match Known::load(&scheduler.0.store, model.model_id, version).await {
        Err(StoreError::Corrupt { detail, .. }) => {
            tracing::warn!(version, detail, "a replay cannot compare with what was before");
            Ok(None)
        }
        loaded => Ok(Some(loaded?)),
    }
}

/// Both on the test events of the one after; on what is left of the other's, where only that one knew the regime.
async fn regimes(
    scheduler: &Scheduler,
    model: &Model,
    before: Option<&Known>,
    after: Option<&Known>,
) -> Result<Vec<ReplayedRegimes>, JobError> {
    let tested = |known: Option<&Known>| -> Vec<(RegimeName, i64)> {
        let regimes = known.into_iter().flat_map(|known| &known.regimes);
        regimes.map(|regime| (regime.evaluation.regime.clone(), regime.reservoir_id)).collect()
    };
    let mut all = tested(after);
    for (regime, reservoir_id) in tested(before) {
        if !all.iter().any(|(known, _)| *known == regime) {
            all.push((regime, reservoir_id));
        }
    }
    let mut regimes = Vec::with_capacity(all.len());
    for (regime, reservoir_id) in all {
        let events = scheduler.0.store.reservoir(reservoir_id).await?;
        let events = Arc::new(at_step(events, model.settings.dt_s));
        let drive = async |known: Option<&Known>| match known {
            Some(known) => Network::of(known).drive(scheduler, &events).await,
            None => Ok(None),
        };
        regimes.push(ReplayedRegimes { before: drive(before).await?, after: drive(after).await?, regime });
    }
    Ok(regimes)
}

/// What is to serve: the policy decides about the head when it is new, or when what serves is tainted.
async fn live(
    scheduler: &Scheduler,
    model: &Model,
    head: Option<&Known>,
    replayed: bool,
) -> Result<ReplayedLive, JobError> {
    let tainted = match model.live {
        Some(live) => scheduler.0.store.is_tainted(model.model_id, live).await?,
        None => false,
    };
    let stays = |reason: &str| ReplayedLive {
        from: model.live,
        to: model.live,
        tainted,
        decision: PromotionDecision::Kept,
        reason: reason.to_owned(),
    };
    let Some(head) = head else {
        let nothing = "everything that the head's line had learned was retracted, so nothing serves";
        return Ok(if tainted {
            ReplayedLive { to: None, tainted: false, ..stays(nothing) }
        } else {
            stays("everything that the head's line had learned was retracted")
        });
    };
    if model.live == Some(head.version.version) {
        return Ok(stays("the head serves already"));
    }
    if head.version.tainted {
        return Ok(stays("the head has learned what was retracted"));
    }
    if !tainted && !replayed {
        return Ok(stays("no stage was learned again"));
    }
    let settings = &model.settings;
    let comparisons = match usable(scheduler, model, model.live).await? {
        Some(live) => Some(comparisons(scheduler, model, head, &live).await?),
        None => None,
    };
    let promotion = settings.promotion.decide(comparisons.as_deref(), settings.promotion_error_ratio);
    let promoted = promotion.decision == PromotionDecision::Promoted;
    Ok(ReplayedLive {
        from: model.live,
        to: if promoted { Some(head.version.version) } else { model.live },
        tainted: tainted && !promoted,
        decision: promotion.decision,
        reason: promotion.reason,
    })
}

/// The head and the live version on the head's test events, regime by regime.
async fn comparisons(
    scheduler: &Scheduler,
    model: &Model,
    head: &Known,
    live: &Known,
) -> Result<Vec<RegimeComparison>, JobError> {
    let mut comparisons = Vec::new();
    for regime in &head.regimes {
        let events = scheduler.0.store.reservoir(regime.reservoir_id).await?;
        let events = Arc::new(at_step(events, model.settings.dt_s));
        let new: Option<TestMeasures> = Network::of(head).drive(scheduler, &events).await?;
        let live = Network::of(live).drive(scheduler, &events).await?;
        if let (Some(new), Some(live)) = (new, live) {
            comparisons.push(RegimeComparison { regime: regime.evaluation.regime.clone(), new, live });
        }
    }
    Ok(comparisons)
}
