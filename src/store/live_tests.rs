//! Promote and rollback against a real database.

use super::*;
use crate::consolidation::Method;
use crate::lineage::{ModelSettings, Promotion, PromotionDecision, PromotionPolicy, RegimeEvaluation};
use crate::store::fixture::{Fixture, now, regime};
use crate::store::new_version::{NewRegime, NewVersion};
use crate::store::outcome::{Finished, Outcome, Overtaken};
use crate::store::task::{self, Start};

fn outcome(judged_against: Option<i64>, decision: PromotionDecision) -> Outcome {
    let evaluation = RegimeEvaluation {
        regime: regime("fast"),
        learned_stage: 1,
        learned_version: 0,
        measures: None,
        served: None,
        before: None,
        diagonal_spacing_mse: None,
        best_spacing_mse: None,
    };
    Outcome {
        version: NewVersion {
            method: Method::Naive,
            settings: ModelSettings::default(),
            strength: None,
            lambda: None,
            strength_search: None,
            kernel: "none".to_owned(),
            train_events: 1,
            events_sha256: [0; 32],
            scaling: serde_json::json!({}),
            importance: serde_json::Value::Null,
            weights: vec![1.0, 2.0],
        },
        memory: None,
        reservoir: Vec::new(),
        regimes: vec![NewRegime { evaluation, shared: None }],
        promotion: Promotion { policy: PromotionPolicy::Auto, decision, reason: "a test".to_owned() },
        judged_against,
    }
}

async fn start(fixture: &Fixture, task_id: i64) {
    let mut transaction = fixture.store.begin().await.unwrap();
    let started = task::start(&mut transaction, task_id, 5, now()).await.unwrap();
    assert!(matches!(started, Start::Running(_)));
    transaction.commit().await.unwrap();
}

async fn finish(fixture: &Fixture, task_id: i64, outcome: &Outcome) -> Result<Finished, Overtaken> {
    let mut transaction = fixture.store.begin().await.unwrap();
    let finished = outcome::succeeded(&mut transaction, task_id, outcome, now()).await.unwrap();
    transaction.commit().await.unwrap();
    finished
}

async fn moved(fixture: &Fixture, model_id: i64, version: Option<i64>) -> Result<Moved, MoveRefused> {
    let mut transaction = fixture.store.begin().await.unwrap();
    let request = MoveRequest { version, reason: "a test", force: false };
    let moved = rollback(&mut transaction, model_id, &request, now()).await.unwrap();
    transaction.commit().await.unwrap();
    moved
}

/// Three learned stages, all live in turn.
async fn three_stages() -> (Fixture, i64) {
    let fixture = Fixture::new().await;
    let model_id = fixture.model("m", Method::Naive, &ModelSettings::default()).await;
    for stage in 0..3_i64 {
        let first = u16::try_from(stage).unwrap() * 10;
        fixture.batch(model_id, "fast", first..first + 2).await;
        let task_id = fixture.tasks_of_pending(model_id).await[0];
        start(&fixture, task_id).await;
        let live = (stage > 0).then_some(stage);
        finish(&fixture, task_id, &outcome(live, PromotionDecision::Promoted)).await.unwrap();
    }
    (fixture, model_id)
}

#[tokio::test]
async fn rollback_moves_live_and_head_and_sets_aside_what_only_abandoned_versions_learned() {
    let (fixture, model_id) = three_stages().await;
    // Batch 1 again: what version 4 learns is what version 1 learned.
    let again = fixture.tasks_of(model_id, &[1]).await[0];
    start(&fixture, again).await;
    finish(&fixture, again, &outcome(Some(3), PromotionDecision::Kept)).await.unwrap();
    fixture.batch(model_id, "fast", 30..32).await;
    let running = fixture.tasks_of_pending(model_id).await[0];
    start(&fixture, running).await;
    fixture.batch(model_id, "slow", 40..42).await;
    fixture.tasks_of_pending(model_id).await;

    let moved = moved(&fixture, model_id, Some(1)).await.unwrap();
    assert_eq!((moved.live, moved.head, moved.from), (Some(1), Some(1), Some(3)));
    assert_eq!(moved.cancelled, [5, 6]);
    assert_eq!(
        fixture.picture(model_id).await,
        "live 1 head 1
task 1 fast succeeded stage 1 parent - version 1 attempt 1
task 2 fast succeeded stage 2 parent 1 version 2 attempt 1
task 3 fast succeeded stage 3 parent 2 version 3 attempt 1
task 4 fast succeeded stage 4 parent 3 version 4 attempt 1
task 5 fast cancelled stage 5 parent 4 version - attempt 1
task 6 slow cancelled stage - parent - version - attempt 0
version 1 parent - stage 1 fast
version 2 parent 1 stage 2 fast
version 3 parent 2 stage 3 fast
version 4 parent 3 stage 4 fast
batch 1 learned 2
batch 2 set_aside 2
batch 3 set_aside 2
batch 4 set_aside 2
batch 5 set_aside 2"
    );
    assert_eq!(
        finish(&fixture, running, &outcome(Some(1), PromotionDecision::Promoted)).await,
        Err(Overtaken::Ended),
        "a task that a rollback overtook writes nothing"
    );
}

#[tokio::test]
async fn rolling_back_to_an_abandoned_version_makes_its_events_learned_again() {
    let (fixture, model_id) = three_stages().await;
    moved(&fixture, model_id, Some(1)).await.unwrap();
    moved(&fixture, model_id, Some(2)).await.unwrap();
    let picture = fixture.picture(model_id).await;
    assert!(picture.ends_with("batch 1 learned 2\nbatch 2 learned 2\nbatch 3 set_aside 2"), "{picture}");
}

#[tokio::test]
async fn rollback_goes_to_the_parent_of_live_by_default_and_says_when_there_is_none() {
    let (fixture, model_id) = three_stages().await;
    assert_eq!(moved(&fixture, model_id, None).await.unwrap().live, Some(2));
    assert_eq!(moved(&fixture, model_id, None).await.unwrap().live, Some(1));
    assert_eq!(moved(&fixture, model_id, None).await, Err(MoveRefused::NoParent(1)));
    assert_eq!(moved(&fixture, model_id, Some(9)).await, Err(MoveRefused::UnknownVersion(9)));
    let empty = fixture.model("empty", Method::Naive, &ModelSettings::default()).await;
    assert_eq!(moved(&fixture, empty, None).await, Err(MoveRefused::NothingLive));
    let reasons: Vec<_> = fixture.store.history(model_id, 3, 10).await.unwrap();
    assert_eq!(
        reasons.iter().map(|e| (e.from_live, e.live)).collect::<Vec<_>>(),
        [(Some(3), Some(2)), (Some(2), Some(1))]
    );
}

#[tokio::test]
async fn promote_moves_live_only() {
    let (fixture, model_id) = three_stages().await;
    let mut transaction = fixture.store.begin().await.unwrap();
    let request = MoveRequest { version: Some(1), reason: "r", force: false };
    let moved = promote(&mut transaction, model_id, &request, now()).await.unwrap().unwrap();
    transaction.commit().await.unwrap();
    assert_eq!((moved.live, moved.head, moved.from), (Some(1), Some(3), Some(3)));
    assert!(fixture.picture(model_id).await.starts_with("live 1 head 3\n"));
}

#[tokio::test]
async fn a_gate_that_judged_against_another_live_version_has_to_judge_again() {
    let (fixture, model_id) = three_stages().await;
    fixture.batch(model_id, "fast", 30..32).await;
    let task_id = fixture.tasks_of_pending(model_id).await[0];
    start(&fixture, task_id).await;
    let stale = finish(&fixture, task_id, &outcome(Some(2), PromotionDecision::Promoted)).await;
    assert_eq!(stale, Err(Overtaken::LiveMoved));
    let fresh = finish(&fixture, task_id, &outcome(Some(3), PromotionDecision::Kept)).await;
    assert_eq!(fresh, Ok(Finished { version: 4, live: false }));
    assert!(fixture.picture(model_id).await.starts_with("live 3 head 4\n"));
}
