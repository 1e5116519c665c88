//! What a line of versions knows of itself, and what goes live.

use std::collections::HashMap;

use super::*;
use crate::lineage::PromotionDecision;
use crate::scheduler::tests::fake::Behaviour;

async fn errors(engine: &Engine, model_id: i64, version: i64) -> Vec<String> {
    let show = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x}"));
    let regimes = engine.fixture.store.evaluation(model_id, version).await.unwrap();
    regimes
        .iter()
        .map(|r| {
            format!(
                "{} stage {} version {} now {} before {} diagonal {} best {}",
                r.regime,
                r.learned_stage,
                r.learned_version,
                show(r.measures.map(|m| m.spacing_mse)),
                show(r.before.map(|m| m.spacing_mse)),
                show(r.diagonal_spacing_mse),
                show(r.best_spacing_mse)
            )
        })
        .collect()
}

fn with_errors(errors: [(&'static str, f32); 3]) -> Script {
    let regimes = errors.into_iter().map(|(name, error)| (name, Behaviour::Err(error))).collect::<HashMap<_, _>>();
    Script { regimes, pace: None }
}

#[tokio::test]
async fn a_version_is_measured_on_every_regime_of_its_line() {
    let engine = Engine::new(with_errors([("a", 3.0), ("b", 2.0), ("c", 4.0)])).await;
    let model_id = engine.model("m").await;
    for (first, regime) in [(0, "a"), (10, "b"), (20, "c"), (30, "a")] {
        engine.learn(model_id, regime, first).await;
    }
    assert_eq!(errors(&engine, model_id, 1).await, ["a stage 1 version 1 now 3 before - diagonal 3 best -"]);
    assert_eq!(
        errors(&engine, model_id, 3).await,
        [
            "a stage 1 version 1 now 4 before - diagonal 3 best 2",
            "b stage 2 version 2 now 4 before - diagonal 2 best 2",
            "c stage 3 version 3 now 4 before 2 diagonal 4 best -"
        ]
    );
    assert_eq!(
        errors(&engine, model_id, 4).await,
        [
            "a stage 4 version 4 now 3 before 4 diagonal 3 best -",
            "b stage 2 version 2 now 3 before - diagonal 2 best 2",
            "c stage 3 version 3 now 3 before - diagonal 4 best 4"
        ]
    );
}

#[tokio::test]
async fn the_gate_keeps_what_drives_worse_than_the_live_version() {
    let engine = Engine::new(with_errors([("a", 2.0), ("b", 3.0), ("c", 2.1)])).await;
    let settings = ModelSettings { promotion: PromotionPolicy::Gated, ..model_settings() };
    let model_id = engine.fixture.model("m", Method::Ewc, &settings).await;
    for (first, regime) in [(0, "a"), (10, "b"), (20, "c")] {
        engine.learn(model_id, regime, first).await;
    }
    // Version 2 errs 1.5 times as much on a; version 3, which continues it, 1.05 times as much as the live version 1.
    assert!(engine.fixture.picture(model_id).await.starts_with("live 3 head 3\n"));
    let kept = engine.fixture.store.version(model_id, 2).await.unwrap().unwrap().promotion;
    assert_eq!(kept.decision, PromotionDecision::Kept);
    assert!(kept.reason.contains("a: spacing MSE 3.000 exceeds 1.1 × the live version's 2.000"), "{}", kept.reason);
    let history = engine.fixture.store.history(model_id, 0, 10).await.unwrap();
    assert_eq!(
        history.iter().map(|h| (h.from_live, h.live)).collect::<Vec<_>>(),
        [(None, Some(1)), (Some(1), Some(3))]
    );
    assert_eq!(engine.served(model_id).await, 3);
}

#[tokio::test]
async fn learning_after_a_rollback_is_as_if_the_abandoned_versions_had_never_been() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.model("m").await;
    for (first, regime) in [(0, "a"), (10, "b"), (20, "c")] {
        engine.learn(model_id, regime, first).await;
    }
    engine.rollback(model_id, 1).await;
    assert_eq!(engine.served(model_id).await, 1);
    engine.learn(model_id, "d", 30).await;

    let other = engine.model("other").await;
    engine.learn(other, "a", 0).await;
    engine.learn(other, "d", 30).await;
    assert_eq!(engine.weights_sha256(model_id, 4).await, engine.weights_sha256(other, 2).await);
    let events = |version: crate::lineage::Version| (version.stage, version.events_sha256);
    let four = engine.fixture.store.version(model_id, 4).await.unwrap().unwrap();
    let two = engine.fixture.store.version(other, 2).await.unwrap().unwrap();
    assert_eq!(events(four), events(two));
}

#[tokio::test]
async fn joint_learns_the_events_of_its_whole_line_afresh() {
    let engine = Engine::new(Script::default()).await;
    let model_id = engine.fixture.model("m", Method::Joint, &model_settings()).await;
    for (first, regime) in [(0, "a"), (10, "b"), (20, "c")] {
        engine.learn(model_id, regime, first).await;
    }
    engine.rollback(model_id, 1).await;
    engine.learn(model_id, "d", 30).await;
    let learned: Vec<_> = engine.fake.log().into_iter().filter(|line| line.contains("stage")).collect();
    assert_eq!(
        learned,
        [
            "a stage 1 from update 0, 7 events, keeps []",
            "b stage 2 from update 0, 14 events, keeps []",
            "c stage 3 from update 0, 21 events, keeps []",
            "d stage 2 from update 0, 14 events, keeps []",
        ]
    );
}

#[tokio::test]
async fn replay_brings_a_bounded_number_of_the_lines_events_of_each_regime() {
    let engine = Engine::new(Script::default()).await;
    let settings = ModelSettings { replay_events: 5, ..model_settings() };
    let model_id = engine.fixture.model("m", Method::Replay, &settings).await;
    for (first, regime) in [(0, "a"), (10, "b"), (20, "c"), (30, "a")] {
        engine.learn(model_id, regime, first).await;
    }
    engine.rollback(model_id, 1).await;
    engine.learn(model_id, "d", 40).await;
    let learned: Vec<_> = engine.fake.log().into_iter().filter(|line| line.contains("stage")).collect();
    assert_eq!(
        learned,
        [
            "a stage 1 from update 0, 7 events, keeps []",
            "b stage 2 from update 0, 7 events, keeps [], 5 of a",
            "c stage 3 from update 0, 7 events, keeps [], 5 of a, 5 of b",
            "a stage 4 from update 0, 7 events, keeps [], 5 of a, 5 of b, 5 of c",
            "d stage 2 from update 0, 7 events, keeps [], 5 of a",
        ]
    );
}
