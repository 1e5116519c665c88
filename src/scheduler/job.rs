//! The learn job: one task from its start to its end.

use std::sync::Arc;

use super::error::JobError;
use super::handle::Scheduler;
use super::observer::JobObserver;
use super::running::{Running, StopReason};
use super::stage::Stage;
use super::{replay, search, verdict};
use crate::lineage::{StrengthSearch, Task, TaskError, TaskKind};
use crate::store::outcome::{self, Finished, Overtaken};
use crate::store::{StoreError, task};
use crate::training::{LearnError, Learned};

/// Runs a started task and sees to it that it ends, whatever happens.
pub(super) async fn supervise(scheduler: Scheduler, task: Task, running: Running) {
    let task_id = task.task_id;
    let job = tokio::spawn(run(scheduler.clone(), task, running.clone()));
    let end = job.await.unwrap_or_else(|join| Err(join.into()));
    // What cannot be written now is not tried again at once, but when the scheduler looks next.
    let may_pass = matches!(&end, Err(JobError::Store(error)) if error.may_pass());
    if let Err(error) = settle(&scheduler, task_id, &running, end).await {
        tracing::error!(task_id, %error, "the end of a task could not be written; it is tried again");
    }
    scheduler.0.running.release(task_id);
    if may_pass {
        // Whoever waits for it to leave is told all the same.
        scheduler.0.changes.send_modify(|changes| *changes += 1);
    } else {
        scheduler.wake();
    }
}

/// Writes how a job that made no version ended.
async fn settle(
    scheduler: &Scheduler,
    task_id: i64,
    running: &Running,
    end: Result<(), JobError>,
) -> Result<(), StoreError> {
    let now = (scheduler.0.clock)();
    let Err(error) = end else { return Ok(()) };
    let mut transaction = scheduler.0.store.begin().await?;
    if !task::is_running(&mut transaction, task_id).await? {
        // It ended, or begins again: with other events, or where the head is now.
        tracing::info!(task_id, %error, "a task was stopped");
        return Ok(());
    }
    match error {
        JobError::Stopped if running.stop.asked() == Some(StopReason::Hold) => {
            let cancelled = task::cancel_requested(&mut transaction, task_id).await?;
            if cancelled {
                outcome::cancelled(&mut transaction, task_id, now).await?;
            } else {
                task::put_back(&mut transaction, task_id).await?;
            }
            tracing::info!(task_id, cancelled, "a task was held");
        }
        JobError::Stopped => {
            outcome::cancelled(&mut transaction, task_id, now).await?;
            tracing::info!(task_id, "a task was cancelled");
        }
        JobError::Failed(error) => {
            outcome::failed(&mut transaction, task_id, &error, now).await?;
            tracing::warn!(task_id, code = error.code, detail = error.detail, "a task failed");
        }
        JobError::Store(error) if error.may_pass() => {
            task::put_back(&mut transaction, task_id).await?;
            tracing::warn!(task_id, %error, "a task waits until the database can be written again");
        }
        error @ (JobError::Store(_) | JobError::Panicked(_)) => {
            // The cause is for the log only.
            let told =
                TaskError { code: "internal".to_owned(), detail: "the server could not learn this task".to_owned() };
            outcome::failed(&mut transaction, task_id, &told, now).await?;
            tracing::error!(task_id, %error, "a task failed");
        }
    }
    transaction.commit().await
}

async fn run(scheduler: Scheduler, task: Task, running: Running) -> Result<(), JobError> {
    let task_id = task.task_id;
    if task.kind == TaskKind::Replay {
        tracing::info!(task_id, attempt = task.attempt, "a replay is measured");
        return replay::conclude(&scheduler, &task, &running).await;
    }
    tracing::info!(task_id, regime = %task.regime, stage = task.stage, attempt = task.attempt, "a task starts");
    let stage = Arc::new(Stage::load(&scheduler.0.store, task).await?);
    if stage.train.is_empty() {
        let detail = "none of the task's events is for training".to_owned();
        return Err(JobError::Failed(TaskError { code: "no_training_events".to_owned(), detail }));
    }
    let (learned, search) = learn(&scheduler, &stage, &running).await?;
    let Finished { version, live } = finish(&scheduler, &stage, learned, search).await?;
    tracing::info!(task_id, version, live, "a task succeeded");
    Ok(())
}

/// Learns the stage from its last checkpoint, with a strength that is searched where it has to be.
async fn learn(
    scheduler: &Scheduler,
    stage: &Arc<Stage>,
    running: &Running,
) -> Result<(Learned, Option<StrengthSearch>), JobError> {
    let task_id = stage.task.task_id;
    let checkpoint = match scheduler.0.store.checkpoint(task_id).await {
        Err(error @ StoreError::Corrupt { .. }) => {
            tracing::warn!(task_id, %error, "a checkpoint is damaged; the task starts afresh");
            None
        }
        read => read?,
    };
    let mut observer = JobObserver::new(scheduler, task_id, running.clone());
    let stage = Arc::clone(stage);
    let learned = scheduler.compute(move |inner| {
        let checkpoint = checkpoint.as_deref();
        let plainly = |observer: &mut JobObserver| inner.learn_or_afresh(task_id, &stage.input(), checkpoint, observer);
        match &stage.search {
            None => Ok((plainly(&mut observer)?, None)),
            Some(validated) => match search::hindrance(validated) {
                Some(why) => Ok((plainly(&mut observer)?, Some(search::not_searched(&stage, validated, why)))),
                None => search::learn(inner, &stage, validated, checkpoint, &mut observer)
                    .map(|(learned, search)| (learned, Some(search))),
            },
        }
    });
    let learned: Result<_, LearnError> = learned.await?;
    Ok(learned?)
}

/// Measures the new version, lets the policy decide, and writes it all; tells the predictor.
async fn finish(
    scheduler: &Scheduler,
    stage: &Stage,
    learned: Learned,
    search: Option<StrengthSearch>,
) -> Result<Finished, JobError> {
    let mut verdict = verdict::measure(scheduler, stage, learned).await?;
    verdict.outcome.version.strength_search = search;
    loop {
        let live = scheduler.0.store.model_by_id(stage.model.model_id).await?.live;
        verdict.decide(scheduler, stage, live).await?;
        let mut transaction = scheduler.0.store.begin().await?;
        let now = (scheduler.0.clock)();
        match outcome::succeeded(&mut transaction, stage.task.task_id, &verdict.outcome, now).await? {
            Ok(finished) => {
                transaction.commit().await?;
                if finished.live {
                    scheduler.0.predictor.refresh(stage.model.model_id).await;
                }
                return Ok(finished);
            }
            Err(Overtaken::LiveMoved) => {}
            Err(Overtaken::Ended | Overtaken::CancelRequested) => return Err(JobError::Stopped),
        }
    }
}
