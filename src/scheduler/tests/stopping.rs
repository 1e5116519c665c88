//! Cancel, pause, shutdown, rollback and crash in the middle of a task.

use super::pace::Pace;
use super::*;
use crate::store::StoreSettings;
use crate::store::task::{self, Cancelled};

/// An engine whose only task has done two of four updates, and waits.
async fn half_way() -> (Engine, i64, Pace) {
    half_way_on(Fixture::new().await).await
}

async fn half_way_on(fixture: Fixture) -> (Engine, i64, Pace) {
    let (mut pace, script) = Pace::new();
    let engine = Engine::on(fixture, script, clock).await;
    let model_id = engine.model("m").await;
    engine.fixture.batch(model_id, "fast", 0..10).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.scheduler.tick().await.unwrap();
    pace.until(2).await;
    (engine, model_id, pace)
}

/// What the same task gives when nothing comes in between.
async fn uninterrupted() -> String {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    engine.learn(model_id, "fast", 0).await;
    engine.weights_sha256(model_id, 1).await
}

#[tokio::test]
async fn cancelling_a_running_task_ends_it_at_its_next_update() {
    let (engine, model_id, pace) = half_way().await;
    let mut transaction = engine.fixture.store.begin().await.unwrap();
    assert_eq!(task::cancel(&mut transaction, model_id, 1, clock()).await.unwrap(), Cancelled::Requested);
    transaction.commit().await.unwrap();
    engine.scheduler.cancel(1);
    pace.free();
    engine.scheduler.settled().await;
    assert_eq!(
        engine.fixture.picture(model_id).await,
        "live - head -
task 1 fast cancelled stage 1 parent - version - attempt 1
batch 1 set_aside 10"
    );
    assert!(engine.fixture.store.checkpoint(1).await.unwrap().is_none());
}

#[tokio::test]
async fn progress_tells_the_share_done() {
    let (engine, _, mut pace) = half_way().await;
    let progress = engine.scheduler.progress(1).unwrap();
    pace.leave.send(()).unwrap();
    pace.until(3).await;
    let told = *progress.borrow();
    assert!((told.share - 0.5).abs() < 1e-12, "{told:?}");
    assert_eq!(told.update.unwrap().update, 2);
    pace.free();
    engine.scheduler.left(1).await;
    assert!(engine.scheduler.progress(1).is_none());
}

#[tokio::test]
async fn a_paused_model_holds_its_task_and_goes_on_from_the_checkpoint() {
    let (engine, model_id, pace) = half_way().await;
    engine.fixture.set_paused(model_id, true).await;
    engine.scheduler.hold(model_id);
    pace.free();
    engine.scheduler.settled().await;
    engine.drain().await;
    assert_eq!(
        engine.fixture.picture(model_id).await,
        "live - head -
task 1 fast queued stage 1 parent - version - attempt 1
batch 1 claimed 10"
    );
    let held = engine.fixture.store.task(model_id, 1).await.unwrap().unwrap();
    assert!((held.checkpointed - 0.5).abs() < 1e-12);
    engine.fixture.set_paused(model_id, false).await;
    engine.drain().await;
    assert_eq!(engine.weights_sha256(model_id, 1).await, uninterrupted().await);
    let log = engine.fake.log();
    assert_eq!(log[1], "fast stage 1 from update 2, 7 events, keeps []");
}

#[tokio::test]
async fn shutting_down_saves_a_checkpoint_and_the_next_process_goes_on_from_it() {
    let (engine, model_id, pace) = half_way().await;
    engine.scheduler.shut_down();
    pace.free();
    engine.scheduler.run().await;
    let Engine { fixture, scheduler, predictor, .. } = engine;
    drop((scheduler, predictor));
    let engine = Engine::on(fixture.reopened().await, Script::default(), clock).await;
    engine.drain().await;
    assert_eq!(engine.fake.log()[0], "fast stage 1 from update 2, 7 events, keeps []");
    assert_eq!(engine.weights_sha256(model_id, 1).await, uninterrupted().await);
}

/// A database whose process died `crashes` times in the middle of its only task, each time on the way from the checkpoint
/// of update 1.
async fn after_crashes(crashes: u32) -> (Engine, i64) {
    let fixture = Fixture::new().await;
    let model_id = fixture.model("m", Method::Ewc, &model_settings()).await;
    fixture.batch(model_id, "fast", 0..10).await;
    fixture.tasks_of_pending(model_id).await;
    start(&fixture).await;
    save_checkpoint(&fixture).await;
    for _ in 1..crashes {
        start(&fixture).await;
    }
    (Engine::on(fixture.reopened().await, Script::default(), clock).await, model_id)
}

async fn start(fixture: &Fixture) {
    let mut transaction = fixture.store.begin().await.unwrap();
    task::start(&mut transaction, 1, 100, clock()).await.unwrap();
    transaction.commit().await.unwrap();
}

async fn save_checkpoint(fixture: &Fixture) {
    let sum: f32 = (0..7).map(|mark| fixture::event(mark).spacing_m()[0]).sum();
    let mut state = vec![1];
    state.extend((0.5 + sum / 1000.0).to_le_bytes());
    fixture.store.save_checkpoint(1, 0.25, &state, clock()).await.unwrap();
}

#[tokio::test]
async fn a_task_whose_process_died_goes_on_first_from_its_checkpoint() {
    let (engine, model_id) = after_crashes(1).await;
    engine.fixture.batch(model_id, "slow", 10..20).await;
    engine.fixture.tasks_of_pending(model_id).await;
    assert_eq!(engine.scheduler.tick().await.unwrap().started, [1]);
    engine.scheduler.settled().await;
    assert_eq!(engine.fake.log()[0], "fast stage 1 from update 1, 7 events, keeps []");
    assert_eq!(engine.weights_sha256(model_id, 1).await, uninterrupted().await);
    let picture = engine.fixture.picture(model_id).await;
    assert!(picture.contains("task 1 fast succeeded stage 1 parent - version 1 attempt 2"), "{picture}");
}

#[tokio::test]
async fn a_damaged_checkpoint_is_left_alone_and_the_task_starts_afresh() {
    let (engine, model_id) = after_crashes(1).await;
    engine.fixture.execute("update checkpoint set state = x'0300000000'").await;
    engine.drain().await;
    assert_eq!(engine.fake.log()[0], "fast stage 1 from update 0, 7 events, keeps []");
    assert_eq!(engine.weights_sha256(model_id, 1).await, uninterrupted().await);
}

#[tokio::test]
async fn a_task_that_kills_its_process_again_and_again_is_given_up() {
    let (engine, model_id) = after_crashes(3).await;
    engine.drain().await;
    assert_eq!(
        engine.fixture.picture(model_id).await,
        "live - head -
task 1 fast failed stage 1 parent - version - attempt 4 error internal
batch 1 held 10"
    );
}

#[tokio::test]
async fn a_task_that_gets_on_between_crashes_is_not_given_up() {
    let fixture = Fixture::new().await;
    let model_id = fixture.model("m", Method::Ewc, &model_settings()).await;
    fixture.batch(model_id, "fast", 0..10).await;
    fixture.tasks_of_pending(model_id).await;
    for _ in 0..10 {
        start(&fixture).await;
        save_checkpoint(&fixture).await;
    }
    let engine = Engine::on(fixture.reopened().await, Script::default(), clock).await;
    engine.drain().await;
    assert_eq!(engine.weights_sha256(model_id, 1).await, uninterrupted().await);
}

#[tokio::test]
async fn a_resumed_task_never_shows_less_than_its_checkpoint() {
    let (engine, _) = after_crashes(1).await;
    let candidate = engine.fixture.store.candidates().await.unwrap()[0];
    let reserved = engine.scheduler.0.running.reserve(candidate.task_id, candidate.model_id, candidate.checkpointed);
    assert_eq!(reserved.progress.borrow().share, 0.25);
}

#[tokio::test]
async fn a_task_of_a_paused_model_can_be_cancelled_after_its_process_died() {
    let (engine, model_id) = after_crashes(1).await;
    engine.fixture.set_paused(model_id, true).await;
    let mut transaction = engine.fixture.store.begin().await.unwrap();
    assert_eq!(task::cancel(&mut transaction, model_id, 1, clock()).await.unwrap(), Cancelled::AtOnce);
    transaction.commit().await.unwrap();
    assert!(engine.fixture.picture(model_id).await.ends_with("batch 1 set_aside 10"));
}

#[tokio::test]
async fn a_cancel_that_the_process_did_not_live_to_carry_out_is_carried_out_at_the_next_start() {
    let fixture = Fixture::new().await;
    let model_id = fixture.model("m", Method::Ewc, &model_settings()).await;
    fixture.batch(model_id, "fast", 0..10).await;
    fixture.tasks_of_pending(model_id).await;
    start(&fixture).await;
    let mut transaction = fixture.store.begin().await.unwrap();
    assert_eq!(task::cancel(&mut transaction, model_id, 1, clock()).await.unwrap(), Cancelled::Requested);
    transaction.commit().await.unwrap();
    let engine = Engine::on(fixture.reopened().await, Script::default(), clock).await;
    engine.drain().await;
    assert!(engine.fixture.picture(model_id).await.ends_with("batch 1 set_aside 10"));
    assert!(engine.fake.log().is_empty());
}

#[tokio::test]
async fn a_rollback_overtakes_the_running_task() {
    let (mut pace, script) = Pace::new();
    let engine = Engine::new(script).await;
    let model_id = engine.model("m").await;
    for (first, regime) in [(0, "fast"), (10, "slow"), (20, "middle")] {
        engine.fixture.batch(model_id, regime, first..first + 10).await;
    }
    engine.fixture.tasks_of_pending(model_id).await;
    for _ in 0..2 {
        engine.scheduler.tick().await.unwrap();
        for _ in 0..4 {
            pace.arrived.recv().await.unwrap();
            pace.leave.send(()).unwrap();
        }
        engine.scheduler.settled().await;
    }
    engine.scheduler.tick().await.unwrap();
    pace.until(4).await;
    // The scheduler is not even told: what the task would write is refused.
    let request = MoveRequest { version: Some(1), reason: "r", force: false };
    let mut transaction = engine.fixture.store.begin().await.unwrap();
    rollback(&mut transaction, model_id, &request, clock()).await.unwrap().unwrap();
    transaction.commit().await.unwrap();
    pace.free();
    engine.scheduler.settled().await;
    assert_eq!(
        engine.fixture.picture(model_id).await,
        "live 1 head 1
task 1 fast succeeded stage 1 parent - version 1 attempt 1
task 2 slow succeeded stage 2 parent 1 version 2 attempt 1
task 3 middle cancelled stage 3 parent 2 version - attempt 1
version 1 parent - stage 1 fast
version 2 parent 1 stage 2 slow
batch 1 learned 10
batch 2 set_aside 10
batch 3 set_aside 10"
    );
}

#[tokio::test]
async fn whoever_waits_for_a_task_is_told_that_it_left_though_its_end_cannot_be_written() {
    let fixture = Fixture::set(|usual| StoreSettings { writer_wait_s: 0.5, ..usual }).await;
    let (engine, model_id, pace) = half_way_on(fixture).await;
    let writing = engine.fixture.store.begin().await.unwrap();
    pace.free();
    engine.scheduler.left(1).await;
    engine.scheduler.settled().await;
    drop(writing);
    engine.drain().await;
    assert_eq!(engine.served(model_id).await, 1);
    assert_eq!(engine.weights_sha256(model_id, 1).await, uninterrupted().await);
}
