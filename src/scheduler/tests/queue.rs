//! Which task runs when, and how it ends.

use std::collections::HashMap;

use super::*;
use crate::scheduler::tests::fake::Behaviour;

#[tokio::test]
async fn tasks_of_a_model_are_learned_in_order_each_from_the_one_before() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    for (first, regime) in [(0, "fast"), (10, "slow"), (20, "fast")] {
        engine.fixture.batch(model_id, regime, first..first + 10).await;
        engine.fixture.tasks_of_pending(model_id).await;
    }
    let first_turn = engine.scheduler.tick().await.unwrap();
    assert_eq!((first_turn.started.clone(), first_turn.running), (vec![1], 1), "one at a time per model");
    engine.scheduler.settled().await;
    engine.drain().await;
    assert_eq!(
        engine.fixture.picture(model_id).await,
        "live 3 head 3
task 1 fast succeeded stage 1 parent - version 1 attempt 1
task 2 slow succeeded stage 2 parent 1 version 2 attempt 1
task 3 fast succeeded stage 3 parent 2 version 3 attempt 1
version 1 parent - stage 1 fast
version 2 parent 1 stage 2 slow
version 3 parent 2 stage 3 fast
batch 1 learned 10
batch 2 learned 10
batch 3 learned 10"
    );
    assert_eq!(
        engine.fake.log(),
        [
            "fast stage 1 from update 0, 7 events, keeps []",
            "drive 2 events",
            "slow stage 2 from update 0, 7 events, keeps [fast]",
            "drive 2 events",
            "drive 2 events",
            "drive 2 events",
            "fast stage 3 from update 0, 7 events, keeps [fast slow]",
            "drive 4 events",
            "drive 4 events",
            "drive 2 events",
        ]
    );
    assert_eq!(engine.served(model_id).await, 3);
}

#[tokio::test]
async fn models_learn_side_by_side_within_the_limit() {
    let engine = Engine::new(Script::default()).await;
    for name in ["a", "b", "c"] {
        let model_id = engine.model(name).await;
        engine.fixture.batch(model_id, "fast", 0..10).await;
        engine.fixture.tasks_of_pending(model_id).await;
    }
    let turn = engine.scheduler.tick().await.unwrap();
    assert_eq!(turn.started[..2], [1, 2]);
    engine.scheduler.settled().await;
    engine.drain().await;
    for model_id in 1..=3 {
        assert!(engine.fixture.picture(model_id).await.starts_with("live 1 head 1\n"));
    }
}

#[tokio::test]
async fn a_task_that_cannot_be_learned_holds_its_events_and_the_next_goes_on() {
    let regimes = HashMap::from([("wild", Behaviour::Diverge), ("broken", Behaviour::Panic)]);
    let engine = Engine::new(Script { regimes, pace: None }).await;
    let model_id = engine.model("m").await;
    for (first, regime) in [(0, "wild"), (10, "broken"), (20, "fast")] {
        engine.fixture.batch(model_id, regime, first..first + 10).await;
    }
    engine.fixture.tasks_of_pending(model_id).await;
    engine.drain().await;
    assert_eq!(
        engine.fixture.picture(model_id).await,
        "live 1 head 1
task 1 wild failed stage 1 parent - version - attempt 1 error diverged
task 2 broken failed stage 1 parent - version - attempt 1 error internal
task 3 fast succeeded stage 1 parent - version 1 attempt 1
version 1 parent - stage 1 fast
batch 1 held 10
batch 2 held 10
batch 3 learned 10"
    );
    let told = engine.fixture.store.task(model_id, 2).await.unwrap().unwrap().error.unwrap();
    assert!(!told.detail.contains("as told"), "the cause of a bug is for the log: {}", told.detail);
}

#[tokio::test]
async fn a_task_without_training_events_fails() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    engine.fixture.batch(model_id, "fast", 0..10).await;
    engine.fixture.execute("update event set split = 'test'").await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.drain().await;
    let picture = engine.fixture.picture(model_id).await;
    assert!(picture.contains("error no_training_events"), "{picture}");
}

#[tokio::test]
async fn a_line_learns_no_more_regimes_than_its_limit_and_still_repeats_those_it_knows() {
    let engine = Engine::new(Script::default()).await;
    let settings = ModelSettings { max_regimes: 2, ..model_settings() };
    let model_id = engine.fixture.model("m", Method::Ewc, &settings).await;
    for (first, regime) in [(0, "a"), (10, "b"), (20, "c"), (30, "a")] {
        engine.learn(model_id, regime, first).await;
    }
    let picture = engine.fixture.picture(model_id).await;
    assert!(
        picture.contains("task 3 c failed stage 3 parent 2 version - attempt 1 error too_many_regimes"),
        "{picture}"
    );
    assert!(picture.contains("task 4 a succeeded stage 3 parent 2 version 3 attempt 1"), "{picture}");
}

#[tokio::test]
async fn events_that_waited_long_enough_become_a_task() {
    fn an_hour_later() -> Timestamp {
        fixture::now() + jiff::SignedDuration::from_hours(1)
    }
    let engine = Engine::on(Fixture::new().await, Script::default(), an_hour_later).await;
    let model_id = engine.model("m").await;
    engine.fixture.batch(model_id, "fast", 0..10).await;
    assert_eq!(engine.scheduler.tick().await.unwrap().triggered, [1]);
    engine.scheduler.settled().await;
    assert!(engine.fixture.picture(model_id).await.ends_with("batch 1 learned 10"));

    let early = Engine::new(Script::default()).await;
    let model_id = early.model("m").await;
    early.fixture.batch(model_id, "fast", 0..10).await;
    assert_eq!(early.scheduler.tick().await.unwrap(), crate::scheduler::TickOutcome::default());
}
