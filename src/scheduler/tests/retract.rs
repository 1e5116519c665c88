//! What was learned of a batch that nobody wants any more is learned again without it.

use std::collections::HashMap;

use super::pace::Pace;
use super::*;
use crate::lineage::{PromotionDecision, ReplayReport, TaskState};
use crate::scheduler::tests::fake::Behaviour;
use crate::store::live::{MoveRefused, promote};

const METHODS: [Method; 5] = [Method::Naive, Method::Ewc, Method::Joint, Method::Replay, Method::ReplayMas];

async fn report(engine: &Engine, model_id: i64, replay: i64) -> ReplayReport {
    let task = engine.fixture.store.task(model_id, replay).await.unwrap().unwrap();
    assert_eq!(task.state, TaskState::Succeeded);
    task.report.unwrap()
}

async fn tainted(engine: &Engine, model_id: i64) -> Vec<i64> {
    let versions = engine.fixture.store.versions(model_id, 0, 100).await.unwrap();
    versions.into_iter().filter(|version| version.tainted).map(|version| version.version).collect()
}

#[tokio::test]
async fn the_replayed_head_is_what_a_model_learns_that_never_saw_the_batch_by_every_method() {
    for method in METHODS {
        let engine = Engine::new(Script::default()).await;
        let model_id = engine.fixture.model("m", method, &model_settings()).await;
        for (first, regime) in [(0, "a"), (10, "b"), (20, "a"), (30, "c")] {
            engine.learn(model_id, regime, first).await;
        }
        let replay = engine.retract(model_id, 2).await.unwrap();
        engine.drain().await;
        let clean = engine.fixture.model("clean", method, &model_settings()).await;
        for (first, regime) in [(0, "a"), (20, "a"), (30, "c")] {
            engine.learn(clean, regime, first).await;
        }
        let head = engine.fixture.store.model_by_id(model_id).await.unwrap().head.unwrap();
        assert_eq!(head, 6, "{method:?}");
        assert_eq!(engine.weights_sha256(model_id, 5).await, engine.weights_sha256(clean, 2).await, "{method:?}");
        assert_eq!(engine.weights_sha256(model_id, 6).await, engine.weights_sha256(clean, 3).await, "{method:?}");
        assert_ne!(engine.weights_sha256(model_id, 4).await, engine.weights_sha256(model_id, 6).await);
        assert_eq!(tainted(&engine, model_id).await, [2, 3, 4]);
        let told = report(&engine, model_id, replay).await;
        let stages: Vec<_> = told.stages.iter().map(|stage| (stage.version, stage.replayed_as)).collect();
        assert_eq!(stages, [(2, None), (3, Some(5)), (4, Some(6))]);
        assert_eq!((told.before, told.after, told.live.from, told.live.to), (Some(4), Some(6), Some(4), Some(6)));
        let regimes: Vec<_> = told.regimes.iter().map(|it| (it.regime.as_str(), it.before.is_some())).collect();
        assert_eq!(regimes, [("a", true), ("c", true), ("b", false)], "nothing is left to test b on");
        assert_eq!(engine.served(model_id).await, 6);
    }
}

#[tokio::test]
async fn what_another_batch_holds_as_well_stays_in_its_stage() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    engine.learn(model_id, "a", 0).await;
    engine.learn(model_id, "b", 10).await;
    engine.fixture.batch(model_id, "b", 10..14).await;
    assert_eq!(engine.fixture.tasks_of(model_id, &[3]).await, [3]);
    engine.drain().await;
    engine.retract(model_id, 2).await.unwrap();
    engine.drain().await;
    let learned: Vec<_> = engine.fake.log().into_iter().filter(|line| line.contains("stage")).collect();
    assert_eq!(
        learned[3..],
        ["b stage 2 from update 0, 4 events, keeps [a]", "b stage 3 from update 0, 4 events, keeps [a b]"]
    );
    let picture = engine.fixture.picture(model_id).await;
    assert!(picture.ends_with("batch 1 learned 10\nbatch 2 retracted 6\nbatch 3 learned 4"), "{picture}");
}

#[tokio::test]
async fn with_nothing_left_nothing_serves_and_the_next_stage_is_the_first() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    engine.learn(model_id, "a", 0).await;
    let replay = engine.retract(model_id, 1).await.unwrap();
    engine.drain().await;
    let told = report(&engine, model_id, replay).await;
    assert_eq!((told.before, told.after, told.live.to), (Some(1), None, None));
    assert!(engine.fixture.picture(model_id).await.starts_with("live - head -\n"));
    assert!(engine.predictor.version(model_id, None).await.is_err());
    engine.learn(model_id, "b", 20).await;
    let version = engine.fixture.store.version(model_id, 2).await.unwrap().unwrap();
    assert_eq!((version.parent, version.stage, version.tainted), (None, 1, false));
    assert_eq!(engine.served(model_id).await, 2);
}

#[tokio::test]
async fn the_gate_keeps_a_tainted_version_live_where_the_replayed_one_is_worse_and_lets_the_next_good_one_serve() {
    let errors = [("a", 3.0), ("b", 2.0), ("c", 9.0), ("d", 2.0)];
    let regimes: HashMap<_, _> = errors.into_iter().map(|(name, error)| (name, Behaviour::Err(error))).collect();
    let engine = Engine::new(Script { regimes, pace: None }).await;
    let settings = ModelSettings { promotion: PromotionPolicy::Gated, ..model_settings() };
    let model_id = engine.fixture.model("m", Method::Ewc, &settings).await;
    engine.learn(model_id, "a", 0).await;
    engine.learn(model_id, "b", 10).await;
    engine.learn(model_id, "c", 20).await;
    assert!(engine.fixture.picture(model_id).await.starts_with("live 2 head 3\n"));
    let replay = engine.retract(model_id, 2).await.unwrap();
    engine.drain().await;
    let told = report(&engine, model_id, replay).await;
    assert_eq!((told.live.to, told.live.tainted, told.live.decision), (Some(2), true, PromotionDecision::Kept));
    assert!(told.live.reason.contains("exceeds"), "{}", told.live.reason);
    engine.learn(model_id, "d", 30).await;
    assert!(engine.fixture.picture(model_id).await.starts_with("live 5 head 5\n"));
}

#[tokio::test]
async fn a_tainted_version_serves_only_when_somebody_insists_and_what_continues_it_is_tainted_too() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    engine.learn(model_id, "a", 0).await;
    engine.learn(model_id, "b", 10).await;
    engine.retract(model_id, 1).await.unwrap();
    engine.drain().await;
    let store = &engine.fixture.store;
    let request = |force| MoveRequest { version: Some(2), reason: "r", force };
    let mut transaction = store.begin().await.unwrap();
    for refused in [
        promote(&mut transaction, model_id, &request(false), clock()).await.unwrap(),
        rollback(&mut transaction, model_id, &request(false), clock()).await.unwrap(),
    ] {
        assert_eq!(refused, Err(MoveRefused::Tainted(2)));
    }
    rollback(&mut transaction, model_id, &request(true), clock()).await.unwrap().unwrap();
    transaction.commit().await.unwrap();
    engine.learn(model_id, "c", 20).await;
    assert_eq!(tainted(&engine, model_id).await, [1, 2, 4]);
    let kept = store.version(model_id, 4).await.unwrap().unwrap().promotion;
    assert_eq!(kept.decision, PromotionDecision::Kept, "the policy was auto");
    let learned = engine.fake.log().into_iter().rfind(|line| line.contains("stage")).unwrap();
    assert!(learned.starts_with("c stage 3 from update 0, 7 events"), "{learned}");
}

#[tokio::test]
async fn other_tasks_wait_for_the_replay_in_their_order() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    engine.learn(model_id, "a", 0).await;
    engine.learn(model_id, "b", 10).await;
    engine.fixture.set_paused(model_id, true).await;
    for (first, regime) in [(20, "c"), (30, "d")] {
        engine.fixture.batch(model_id, regime, first..first + 10).await;
        engine.fixture.tasks_of_pending(model_id).await;
    }
    engine.retract(model_id, 1).await.unwrap();
    engine.fixture.set_paused(model_id, false).await;
    engine.drain().await;
    let picture = engine.fixture.picture(model_id).await;
    let versions: Vec<_> = picture.lines().filter(|line| line.starts_with("version")).collect();
    assert_eq!(
        versions[2..],
        ["version 3 parent - stage 1 b", "version 4 parent 3 stage 2 c", "version 5 parent 4 stage 3 d"]
    );
}

#[tokio::test]
async fn a_second_retraction_joins_the_replay_under_way() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    for (first, regime) in [(0, "a"), (10, "b"), (20, "c"), (30, "d"), (40, "e")] {
        engine.learn(model_id, regime, first).await;
    }
    let first = engine.retract(model_id, 3).await.unwrap();
    // Of its two parts, one has ended.
    engine.scheduler.tick().await.unwrap();
    engine.scheduler.settled().await;
    let second = engine.retract(model_id, 2).await.unwrap();
    engine.drain().await;
    let clean = engine.model("clean").await;
    for (first, regime) in [(0, "a"), (30, "d"), (40, "e")] {
        engine.learn(clean, regime, first).await;
    }
    let head = engine.fixture.store.model_by_id(model_id).await.unwrap().head.unwrap();
    assert_eq!(engine.weights_sha256(model_id, head).await, engine.weights_sha256(clean, 3).await);
    for replay in [first, second] {
        assert_eq!(report(&engine, model_id, replay).await.after, Some(head));
    }
    assert_eq!(engine.served(model_id).await, head);
}

#[tokio::test]
async fn a_running_task_begins_again_without_what_was_retracted_or_where_the_head_is_by_then() {
    let (mut pace, script) = Pace::new();
    let engine = Engine::new(script).await;
    let model_id = engine.model("m").await;
    engine.fixture.batch(model_id, "a", 0..10).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.scheduler.tick().await.unwrap();
    pace.until(4).await;
    pace.leave.send(()).unwrap();
    engine.scheduler.settled().await;
    engine.fixture.batch(model_id, "b", 10..20).await;
    engine.fixture.batch(model_id, "b", 20..30).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.scheduler.tick().await.unwrap();
    pace.until(1).await;
    // One of its batches leaves, and then the one that its parent learned.
    assert_eq!(engine.retract(model_id, 2).await, None);
    assert!(engine.retract(model_id, 1).await.is_some());
    pace.free();
    engine.scheduler.settled().await;
    engine.drain().await;
    let learned: Vec<_> = engine.fake.log().into_iter().filter(|line| line.contains("stage")).collect();
    assert_eq!(
        learned,
        [
            "a stage 1 from update 0, 7 events, keeps []",
            "b stage 2 from update 0, 14 events, keeps [a]",
            "b stage 1 from update 0, 7 events, keeps []"
        ]
    );
    let task = engine.fixture.store.task(model_id, 2).await.unwrap().unwrap();
    assert_eq!((task.state, task.batches, task.version), (TaskState::Succeeded, vec![3], Some(2)));
}

#[tokio::test]
async fn content_that_was_retracted_may_come_and_go_again() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    engine.learn(model_id, "a", 0).await;
    engine.learn(model_id, "b", 10).await;
    engine.retract(model_id, 2).await.unwrap();
    engine.drain().await;
    let head = engine.fixture.store.model_by_id(model_id).await.unwrap().head;
    assert_eq!(head, Some(1));
    assert_eq!(engine.served(model_id).await, 1);
    // Uploaded anew and never learned: what a version of before learned counts no more.
    engine.fixture.execute("update event set state = 'pending', batch_id = 1 where batch_id = 2").await;
    engine
        .fixture
        .execute(
            "insert into batch (model_id, content_type, body_sha256, body_bytes, accepted, duplicates,
        rejected, summary, created_at) select model_id, content_type, body_sha256, body_bytes, accepted, duplicates,
        rejected, summary, created_at from batch where batch_id = 2",
        )
        .await;
    engine
        .fixture
        .execute("insert into batch_event select 3, ordinal, event_id, 0 from batch_event where batch_id = 2")
        .await;
    assert_eq!(engine.retract(model_id, 3).await, None);
}

#[tokio::test]
async fn a_head_that_is_corrupt_is_replaced_without_being_compared() {
    let engine = Engine::new(Script::default()).await;
    let settings = ModelSettings { promotion: PromotionPolicy::Gated, ..model_settings() };
    let model_id = engine.fixture.model("m", Method::Ewc, &settings).await;
    for (first, regime) in [(0, "a"), (10, "b"), (20, "c")] {
        engine.learn(model_id, regime, first).await;
    }
    engine.fixture.execute("update model set live_version = 3").await;
    engine.fixture.execute("update weights set weights = zeroblob(length(weights)) where version = 3").await;
    let replay = engine.retract(model_id, 2).await.unwrap();
    engine.drain().await;
    let told = report(&engine, model_id, replay).await;
    assert_eq!((told.before, told.after, told.live.to, told.live.tainted), (Some(3), Some(4), Some(4), false));
    assert!(told.regimes.iter().all(|regime| regime.before.is_none()), "{told:?}");
    assert_eq!(engine.served(model_id).await, 4);
}
