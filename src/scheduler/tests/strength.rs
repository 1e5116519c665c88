//! Tasks that find their own strength.

use super::fake::Behaviour;
use super::pace::Pace;
use super::*;
use crate::lineage::{Auto, Strength, StrengthSearch};
use crate::store::task::{self, Cancelled};

/// Squared errors on the earlier and on the new regime: a front whose middle is best.
fn front(strength: Option<f64>) -> [f32; 2] {
    match strength {
        None => [40.0, 8.0],
        Some(0.1) => [40.0, 8.125],
        Some(0.3) => [30.0, 8.25],
        Some(1.0) => [20.5, 8.5],
        Some(3.0) => [20.25, 10.0],
        _ => [20.0, 16.0],
    }
}

/// What a stage comes to with a strength; none where it diverges.
type Front = fn(Option<f64>) -> Option<[f32; 2]>;

const CONVERGES: Front = |strength| Some(front(strength));
const BEST_DIVERGES: Front = |strength| CONVERGES(strength).filter(|_| strength != Some(1.0));
const REFERENCE_DIVERGES: Front = |strength| CONVERGES(strength).filter(|_| strength.is_some());
const CANDIDATES_DIVERGE: Front = |strength| CONVERGES(strength).filter(|_| strength.is_none());

fn script(slow: Front) -> Script {
    let regimes = [("fast", Behaviour::Err(20.0)), ("slow", Behaviour::ByStrength(slow))];
    Script { regimes: regimes.into_iter().collect(), ..Script::default() }
}

/// An engine whose model `auto` has learned `fast`.
async fn engine(slow: Front) -> (Engine, i64) {
    let engine = Engine::new(script(slow)).await;
    let settings = ModelSettings { strength: Some(Strength::Searched(Auto::Auto)), ..model_settings() };
    let model_id = engine.fixture.model("auto", Method::Ewc, &settings).await;
    engine.learn(model_id, "fast", 0).await;
    engine.fake.log();
    (engine, model_id)
}

async fn version(engine: &Engine, model_id: i64, version: i64) -> crate::lineage::Version {
    engine.fixture.store.version(model_id, version).await.unwrap().unwrap()
}

/// What a search that nothing disturbs gives.
async fn undisturbed() -> (String, StrengthSearch) {
    let (engine, model_id) = engine(CONVERGES).await;
    engine.learn(model_id, "slow", 10).await;
    let version = version(&engine, model_id, 2).await;
    (version.weights_sha256, version.strength_search.unwrap())
}

const SEARCH: [&str; 7] = [
    "slow stage 2 from update 0, 7 events, keeps []",
    "slow stage 2 from update 0, 7 events, keeps [fast], strength 0.1",
    "slow stage 2 from update 0, 7 events, keeps [fast], strength 0.3",
    "slow stage 2 from update 0, 7 events, keeps [fast], strength 1",
    "slow stage 2 from update 0, 7 events, keeps [fast], strength 3",
    "slow stage 2 from update 0, 7 events, keeps [fast], strength 10",
    "slow stage 2 from update 0, 7 events, keeps [fast], strength 1",
];

fn learned(engine: &Engine) -> Vec<String> {
    engine.fake.log().into_iter().filter(|line| !line.starts_with("drive")).collect()
}

#[tokio::test]
async fn the_strength_that_the_rule_takes_is_learned_with_and_the_version_tells_why() {
    let (engine, model_id) = engine(CONVERGES).await;
    let first = version(&engine, model_id, 1).await;
    assert_eq!(first.strength_search, None, "there is nothing to hold on to at stage 1");
    engine.learn(model_id, "slow", 10).await;
    assert_eq!(learned(&engine), SEARCH);
    let version = version(&engine, model_id, 2).await;
    assert_eq!(version.strength, Some(1.0));
    assert_eq!(version.settings.strength, Some(Strength::Searched(Auto::Auto)));
    let search = version.strength_search.unwrap();
    assert_eq!((search.chosen, search.seed, &search.note), (1.0, 42, &None));
    let regimes: Vec<_> = search.regimes.iter().map(|of| (of.regime.as_str(), of.events, of.earlier)).collect();
    assert_eq!(regimes, [("fast", 1, true), ("slow", 1, false)]);
    assert_eq!(search.naive_diagonal, [Some(20.0), Some(8.0)], "the parent's, and that of the stage without a penalty");
    let strengths: Vec<f64> = search.candidates.iter().map(|candidate| candidate.strength).collect();
    assert_eq!(strengths, [0.1, 0.3, 1.0, 3.0, 10.0]);
    let chosen = &search.candidates[2];
    assert_eq!(chosen.spacing_mse, Some(vec![Some(20.5), Some(8.5)]));
    assert_eq!((chosen.forgetting_ratio, chosen.plasticity_loss), (Some(1.025), Some(1.0625)));
    assert_eq!((chosen.cost, chosen.collisions, &chosen.diverged), (Some(1.04375), Some(0), &None));
}

#[tokio::test]
async fn methods_that_do_not_consolidate_and_numbers_search_nothing() {
    let engine = Engine::new(Script::default()).await;
    let auto = ModelSettings { strength: Some(Strength::Searched(Auto::Auto)), ..model_settings() };
    let fixed = ModelSettings { strength: Some(Strength::Fixed(2.0)), ..model_settings() };
    for (name, method, settings) in
        [("a", Method::Naive, &auto), ("b", Method::Replay, &auto), ("c", Method::Ewc, &fixed)]
    {
        let model_id = engine.fixture.model(name, method, settings).await;
        engine.learn(model_id, "fast", 0).await;
        engine.learn(model_id, "slow", 10).await;
        assert_eq!(learned(&engine).len(), 2, "{name}");
        assert_eq!(version(&engine, model_id, 2).await.strength_search, None);
    }
}

#[tokio::test]
async fn a_task_may_search_where_its_model_does_not() {
    let engine = Engine::new(script(CONVERGES)).await;
    let model_id = engine.model("m").await;
    engine.learn(model_id, "fast", 0).await;
    engine.fixture.batch(model_id, "slow", 10..20).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.fixture.execute("update task set settings = '{\"strength\": \"auto\"}' where state = 'queued'").await;
    engine.drain().await;
    assert_eq!(version(&engine, model_id, 2).await.strength_search.unwrap().chosen, 1.0);
}

#[tokio::test]
async fn a_regime_that_comes_again_counts_as_the_new_one_only() {
    let (engine, model_id) = engine(CONVERGES).await;
    engine.learn(model_id, "slow", 10).await;
    engine.learn(model_id, "slow", 20).await;
    let search = version(&engine, model_id, 3).await.strength_search.unwrap();
    let regimes: Vec<_> = search.regimes.iter().map(|of| (of.regime.as_str(), of.events, of.earlier)).collect();
    assert_eq!(regimes, [("fast", 1, true), ("slow", 1, false)]);
    assert_eq!(search.naive_diagonal[0], Some(20.5));
}

#[tokio::test]
async fn no_more_validation_events_take_part_than_the_reservoir_has_room_for() {
    let engine = Engine::new(script(CONVERGES)).await;
    let strength = Some(Strength::Searched(Auto::Auto));
    let settings = ModelSettings { strength, test_reservoir: 2, ..model_settings() };
    let model_id = engine.fixture.model("m", Method::Ewc, &settings).await;
    engine.fixture.batch(model_id, "fast", 100..140).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.drain().await;
    engine.fixture.batch(model_id, "slow", 10..50).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.drain().await;
    let search = version(&engine, model_id, 2).await.strength_search.unwrap();
    assert_eq!(search.regimes.iter().map(|of| of.events).collect::<Vec<_>>(), [2, 2]);
}

#[tokio::test]
async fn without_validation_events_the_default_is_used_and_the_version_says_so() {
    let (engine, model_id) = engine(CONVERGES).await;
    engine.fixture.batch(model_id, "slow", 10..17).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.drain().await;
    assert_eq!(learned(&engine), ["slow stage 2 from update 0, 7 events, keeps [fast]"]);
    let version = version(&engine, model_id, 2).await;
    let search = version.strength_search.unwrap();
    assert_eq!((version.strength, search.chosen, search.candidates.len()), (Some(1.0), 1.0, 0));
    assert_eq!(search.regimes[1].events, 0);
    assert!(search.note.unwrap().starts_with("the task has no validation events"));
}

#[tokio::test]
async fn where_no_earlier_regime_has_validation_events_forgetting_cannot_be_seen() {
    let engine = Engine::new(script(CONVERGES)).await;
    let settings = ModelSettings { strength: Some(Strength::Searched(Auto::Auto)), ..model_settings() };
    let model_id = engine.fixture.model("m", Method::Ewc, &settings).await;
    engine.fixture.batch(model_id, "fast", 0..7).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.drain().await;
    engine.learn(model_id, "slow", 10).await;
    let search = version(&engine, model_id, 2).await.strength_search.unwrap();
    assert!(search.note.unwrap().starts_with("no regime learned earlier"));
    assert_eq!(search.chosen, 1.0);
}

#[tokio::test]
async fn a_strength_that_diverges_is_out_and_the_others_go_on() {
    let (engine, model_id) = engine(BEST_DIVERGES).await;
    engine.learn(model_id, "slow", 10).await;
    let version = version(&engine, model_id, 2).await;
    assert_eq!(version.strength, Some(3.0));
    let search = version.strength_search.unwrap();
    let out = &search.candidates[2];
    assert_eq!((out.strength, out.cost, &out.spacing_mse), (1.0, None, &None));
    assert_eq!(out.diverged.as_deref(), Some("training diverged at update 1: as told"));
}

#[tokio::test]
async fn without_a_reference_the_candidates_are_measured_against_the_best_of_them() {
    let (engine, model_id) = engine(REFERENCE_DIVERGES).await;
    engine.learn(model_id, "slow", 10).await;
    let search = version(&engine, model_id, 2).await.strength_search.unwrap();
    assert_eq!((search.naive_diagonal, search.chosen), (vec![Some(20.0), Some(8.125)], 1.0));
    assert!(search.note.unwrap().starts_with("without a penalty training diverged"));
}

#[tokio::test]
async fn a_task_fails_when_every_strength_diverges() {
    let (engine, model_id) = engine(CANDIDATES_DIVERGE).await;
    engine.learn(model_id, "slow", 10).await;
    let picture = engine.fixture.picture(model_id).await;
    assert!(picture.contains("task 2 slow failed stage 2 parent 1 version - attempt 1 error diverged"), "{picture}");
}

/// An engine whose task stands at the second update of the third stage of its search.
async fn inside_a_search() -> (Engine, i64, Pace) {
    let (before, model_id) = engine(CONVERGES).await;
    let Engine { fixture, scheduler, predictor, .. } = before;
    drop((scheduler, predictor));
    let (mut pace, paced) = Pace::new();
    let engine = Engine::on(fixture.reopened().await, Script { pace: paced.pace, ..script(CONVERGES) }, clock).await;
    engine.fixture.batch(model_id, "slow", 10..20).await;
    engine.fixture.tasks_of_pending(model_id).await;
    engine.scheduler.tick().await.unwrap();
    for _ in 0..2 {
        pace.until(4).await;
        pace.leave.send(()).unwrap();
    }
    pace.until(2).await;
    (engine, model_id, pace)
}

/// Lets the engine put its task back, and ends it; what is left is the database.
async fn held(engine: Engine, pace: Pace) -> Fixture {
    engine.scheduler.shut_down();
    pace.free();
    engine.scheduler.run().await;
    engine.fixture
}

#[tokio::test]
async fn progress_counts_the_whole_search_and_says_where_it_is() {
    let (engine, _, mut pace) = inside_a_search().await;
    let progress = engine.scheduler.progress(2).unwrap();
    pace.leave.send(()).unwrap();
    pace.until(3).await;
    let told = *progress.borrow();
    assert!((told.share - 2.5 / 7.0).abs() < 1e-12, "{told:?}");
    let search = told.search.unwrap();
    assert_eq!((search.learning, search.of, search.strength), (3, 7, 0.3));
    assert_eq!(told.update.unwrap().update, 2);
    pace.free();
    engine.scheduler.left(2).await;
}

#[tokio::test]
async fn a_search_that_is_held_goes_on_where_it_was_and_ends_with_the_same_bits() {
    let (engine, model_id, pace) = inside_a_search().await;
    let fixture = held(engine, pace).await;
    let engine = Engine::on(fixture.reopened().await, script(CONVERGES), clock).await;
    let task = engine.fixture.store.task(model_id, 2).await.unwrap().unwrap();
    assert!((task.checkpointed - 2.5 / 7.0).abs() < 1e-12, "{task:?}");
    engine.drain().await;
    let mut left = SEARCH[2..].to_vec();
    left[0] = "slow stage 2 from update 2, 7 events, keeps [fast], strength 0.3";
    assert_eq!(learned(&engine), left);
    let version = version(&engine, model_id, 2).await;
    let (weights_sha256, search) = undisturbed().await;
    assert_eq!((version.weights_sha256, version.strength_search), (weights_sha256, Some(search)));
}

#[tokio::test]
async fn a_search_whose_stage_ended_before_the_process_did_goes_on_with_the_next() {
    let (engine, model_id, pace) = inside_a_search().await;
    // What the last update of the stage before left.
    let state = engine.fixture.store.checkpoint(2).await.unwrap().unwrap();
    let fixture = held(engine, pace).await;
    // The stage's own state has a first byte for the update and four for a weight.
    let between = &state[..state.len() - 5];
    fixture.execute("update task set state = 'running' where task_id = 2").await;
    fixture.store.save_checkpoint(2, 2.0 / 7.0, between, clock()).await.unwrap();
    let engine = Engine::on(fixture.reopened().await, script(CONVERGES), clock).await;
    engine.drain().await;
    assert_eq!(learned(&engine), SEARCH[2..]);
    assert_eq!(engine.weights_sha256(model_id, 2).await, undisturbed().await.0);
}

#[tokio::test]
async fn a_checkpoint_of_another_search_is_left_alone() {
    let (engine, model_id, pace) = inside_a_search().await;
    let fixture = held(engine, pace).await;
    let mut state = fixture.store.checkpoint(2).await.unwrap().unwrap();
    state[8] ^= 1;
    fixture.execute("update task set state = 'running' where task_id = 2").await;
    fixture.store.save_checkpoint(2, 0.3, &state, clock()).await.unwrap();
    let engine = Engine::on(fixture.reopened().await, script(CONVERGES), clock).await;
    engine.drain().await;
    assert_eq!(learned(&engine), SEARCH);
    assert_eq!(engine.weights_sha256(model_id, 2).await, undisturbed().await.0);
}

#[tokio::test]
async fn cancelling_ends_a_search_at_its_next_update() {
    let (engine, model_id, pace) = inside_a_search().await;
    let mut transaction = engine.fixture.store.begin().await.unwrap();
    assert_eq!(task::cancel(&mut transaction, model_id, 2, clock()).await.unwrap(), Cancelled::Requested);
    transaction.commit().await.unwrap();
    engine.scheduler.cancel(2);
    pace.free();
    engine.scheduler.settled().await;
    let picture = engine.fixture.picture(model_id).await;
    assert!(picture.contains("task 2 slow cancelled stage 2 parent 1 version - attempt 1"), "{picture}");
    assert!(picture.ends_with("batch 2 set_aside 10"), "{picture}");
    assert!(engine.fixture.store.checkpoint(2).await.unwrap().is_none());
    assert_eq!(learned(&engine), SEARCH[..3]);
}
