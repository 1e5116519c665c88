//! Turned by hand, with a learner that is quick and does as it is told.

mod corruption;
mod cost;
mod fake;
mod lineage;
mod pace;
mod queue;
mod retract;
mod stopping;
mod strength;

use std::sync::Arc;

use fake::{Fake, Script};
use jiff::Timestamp;

use super::{Scheduler, SchedulerSettings};
use crate::consolidation::Method;
use crate::lineage::{ModelSettings, PromotionPolicy};
use crate::predictor::{Predictor, PredictorSettings};
use crate::store::fixture::{self, Fixture};
use crate::store::live::{MoveRequest, Moved, rollback};
use crate::store::retract::{Retracted, retract};

fn scheduler_settings() -> SchedulerSettings {
    SchedulerSettings {
        parallel_tasks: 2,
        training_threads: 1,
        niceness: 0,
        checkpoint_s: 0.0,
        trigger_interval_s: 60.0,
        max_crashes: 2,
    }
}

fn model_settings() -> ModelSettings {
    ModelSettings { hidden: 2, promotion: PromotionPolicy::Auto, ..ModelSettings::default() }
}

fn clock() -> Timestamp {
    fixture::now()
}

/// A server's engine on a database of its own.
struct Engine {
    fixture: Fixture,
    scheduler: Scheduler,
    predictor: Arc<Predictor>,
    fake: Fake,
}

impl Engine {
    async fn new(script: Script) -> Self {
        Self::on(Fixture::new().await, script, clock).await
    }

    async fn on(fixture: Fixture, script: Script, clock: fn() -> Timestamp) -> Self {
        let settings = PredictorSettings {
            named_versions: 2,
            inline_windows: 64,
            waiting_windows: 64,
            threads: 1,
            sequences: 2,
            sequence_idle_s: 60.0,
        };
        let predictor = Arc::new(Predictor::new(Arc::clone(&fixture.store), settings));
        predictor.load_all().await.unwrap();
        let fake = Fake::new(script);
        let learner = Box::new(fake.clone());
        let store = Arc::clone(&fixture.store);
        let scheduler = Scheduler::new(scheduler_settings(), store, Arc::clone(&predictor), learner, clock).unwrap();
        scheduler.take_over().await.unwrap();
        Self { fixture, scheduler, predictor, fake }
    }

    async fn model(&self, name: &str) -> i64 {
        self.fixture.model(name, Method::Ewc, &model_settings()).await
    }

    /// Turns until nothing is left to do.
    async fn drain(&self) {
        while !self.scheduler.tick().await.unwrap().is_idle() {
            self.scheduler.settled().await;
        }
    }

    /// A batch of ten events, its task, and all of it learned.
    async fn learn(&self, model_id: i64, regime: &str, first: u16) -> i64 {
        self.fixture.batch(model_id, regime, first..first + 10).await;
        let task = self.fixture.tasks_of_pending(model_id).await[0];
        self.drain().await;
        task
    }

    async fn rollback(&self, model_id: i64, version: i64) -> Moved {
        let request = MoveRequest { version: Some(version), reason: "r", force: false };
        let mut transaction = self.fixture.store.begin().await.unwrap();
        let moved = rollback(&mut transaction, model_id, &request, clock()).await.unwrap().unwrap();
        transaction.commit().await.unwrap();
        for &task_id in &moved.cancelled {
            self.scheduler.cancel(task_id);
        }
        self.predictor.refresh(model_id).await;
        moved
    }

    /// Retracts a batch and tells the scheduler; gives the replay.
    async fn retract(&self, model_id: i64, batch_id: i64) -> Option<i64> {
        let mut transaction = self.fixture.store.begin().await.unwrap();
        let retracted = retract(&mut transaction, model_id, batch_id, clock()).await.unwrap();
        transaction.commit().await.unwrap();
        let (stopped, replay) = match retracted {
            Retracted::Done { stopped, .. } => (stopped, None),
            Retracted::Replaying { task_id, stopped } => (stopped, Some(task_id)),
            other => panic!("{other:?}"),
        };
        for task_id in stopped {
            self.scheduler.cancel(task_id);
        }
        replay
    }

    async fn weights_sha256(&self, model_id: i64, version: i64) -> String {
        self.fixture.store.version(model_id, version).await.unwrap().unwrap().weights_sha256
    }

    async fn served(&self, model_id: i64) -> i64 {
        self.predictor.version(model_id, None).await.unwrap().version()
    }
}
