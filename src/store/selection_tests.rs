//! What a request selects, against a real database.

use super::*;
use crate::consolidation::Method;
use crate::lineage::ModelSettings;
use crate::store::fixture::{Fixture, now, regime};
use crate::store::{outcome, retract, task};

async fn fixture() -> (Fixture, i64) {
    let fixture = Fixture::new().await;
    let model_id = fixture.model("m", Method::Naive, &ModelSettings::default()).await;
    (fixture, model_id)
}

async fn create(fixture: &Fixture, model_id: i64, request: &TaskRequest) -> Result<Vec<i64>, NoTask> {
    let mut transaction = fixture.store.begin().await.unwrap();
    let tasks = create_tasks(&mut transaction, model_id, request, now()).await.unwrap();
    transaction.commit().await.unwrap();
    tasks
}

fn pending(regime: Option<RegimeName>) -> TaskRequest {
    TaskRequest { selection: Selection::Pending { regime }, mean_speed_mps: None, settings: Value::Null }
}

#[tokio::test]
async fn pending_events_make_one_task_a_regime_in_order_of_arrival() {
    let (fixture, model_id) = fixture().await;
    fixture.batch(model_id, "slow", 0..3).await;
    fixture.batch(model_id, "fast", 3..5).await;
    fixture.batch(model_id, "slow", 5..6).await;
    assert_eq!(create(&fixture, model_id, &pending(None)).await, Ok(vec![1, 2]));
    let tasks = fixture.store.tasks(model_id, 0, 10).await.unwrap();
    let seen: Vec<_> = tasks.iter().map(|t| (t.regime.as_str(), t.batches.clone())).collect();
    assert_eq!(seen, [("slow", vec![1, 3]), ("fast", vec![2])]);
    assert_eq!(create(&fixture, model_id, &pending(None)).await, Err(NoTask::NothingPending));
}

#[tokio::test]
async fn a_regime_or_a_range_of_speeds_narrows_the_selection() {
    let (fixture, model_id) = fixture().await;
    fixture.batch(model_id, "slow", 0..3).await;
    fixture.batch(model_id, "fast", 3..5).await;
    assert_eq!(create(&fixture, model_id, &pending(Some(regime("other")))).await, Err(NoTask::NothingPending));
    let out_of_range = TaskRequest { mean_speed_mps: Some([10.5, 20.0]), ..pending(None) };
    assert_eq!(create(&fixture, model_id, &out_of_range).await, Err(NoTask::NothingPending));
    let fast = TaskRequest { mean_speed_mps: Some([9.0, 10.0]), ..pending(Some(regime("fast"))) };
    assert_eq!(create(&fixture, model_id, &fast).await, Ok(vec![1]));
    let picture = fixture.picture(model_id).await;
    assert!(picture.ends_with("batch 1 pending 3\nbatch 2 claimed 2"), "{picture}");
}

#[tokio::test]
async fn named_batches_are_learned_under_one_name_and_bring_back_what_was_set_aside() {
    let (fixture, model_id) = fixture().await;
    fixture.batch(model_id, "slow", 0..3).await;
    fixture.batch(model_id, "fast", 3..5).await;
    let request = TaskRequest {
        selection: Selection::Batches { batches: vec![1, 2], regime: Some(regime("both")) },
        mean_speed_mps: None,
        settings: Value::Null,
    };
    assert_eq!(create(&fixture, model_id, &request).await, Ok(vec![1]));
    let mut transaction = fixture.store.begin().await.unwrap();
    assert_eq!(task::cancel(&mut transaction, model_id, 1, now()).await.unwrap(), task::Cancelled::AtOnce);
    transaction.commit().await.unwrap();
    assert_eq!(create(&fixture, model_id, &pending(None)).await, Err(NoTask::NothingPending));
    assert_eq!(create(&fixture, model_id, &request).await, Ok(vec![2]));
    let task = fixture.store.task(model_id, 2).await.unwrap().unwrap();
    assert_eq!((task.regime.as_str(), task.batches), ("both", vec![1, 2]));
}

#[tokio::test]
async fn an_unknown_or_retracted_batch_is_named() {
    let (fixture, model_id) = fixture().await;
    let batch = fixture.batch(model_id, "slow", 0..3).await;
    let mut transaction = fixture.store.begin().await.unwrap();
    let retracted = retract::retract(&mut transaction, model_id, batch, now()).await.unwrap();
    assert_eq!(retracted, retract::Retracted::Done { events: 3, stopped: Vec::new() });
    transaction.commit().await.unwrap();
    for (named, refusal) in [(batch, NoTask::RetractedBatch(batch)), (9, NoTask::UnknownBatch(9))] {
        let selection = Selection::Batches { batches: vec![named], regime: None };
        assert_eq!(create(&fixture, model_id, &TaskRequest { selection, ..pending(None) }).await, Err(refusal));
    }
}

#[tokio::test]
async fn a_regime_is_due_by_count_or_by_age() {
    let (fixture, model_id) = fixture().await;
    fixture.batch(model_id, "slow", 0..3).await;
    fixture.batch(model_id, "fast", 3..5).await;
    let schedule: Schedule = serde_json::from_str(r#"{"min_events": 3, "max_wait_s": 60}"#).unwrap();
    let mut transaction = fixture.store.begin().await.unwrap();
    assert_eq!(create_due(&mut transaction, model_id, schedule, now()).await.unwrap(), [1]);
    assert!(create_due(&mut transaction, model_id, schedule, now()).await.unwrap().is_empty());
    let later = now() + jiff::SignedDuration::from_secs(60);
    assert_eq!(create_due(&mut transaction, model_id, schedule, later).await.unwrap(), [2]);
}

#[tokio::test]
async fn a_failed_task_holds_its_events_and_naming_the_batch_tries_again() {
    let (fixture, model_id) = fixture().await;
    fixture.batch(model_id, "slow", 0..3).await;
    create(&fixture, model_id, &pending(None)).await.unwrap();
    let error = crate::lineage::TaskError { code: "diverged".to_owned(), detail: "at update 3".to_owned() };
    let mut transaction = fixture.store.begin().await.unwrap();
    assert!(outcome::failed(&mut transaction, 1, &error, now()).await.unwrap());
    assert!(!outcome::failed(&mut transaction, 1, &error, now()).await.unwrap(), "an end is final");
    transaction.commit().await.unwrap();
    assert_eq!(fixture.store.task(model_id, 1).await.unwrap().unwrap().error, Some(error));
    assert!(fixture.picture(model_id).await.ends_with("batch 1 held 3"));
    assert_eq!(fixture.tasks_of(model_id, &[1]).await, [2]);
}

#[tokio::test]
async fn what_another_batch_holds_survives_a_retraction() {
    let (fixture, model_id) = fixture().await;
    fixture.batch(model_id, "slow", 0..3).await;
    fixture.batch(model_id, "slow", 1..3).await;
    let mut transaction = fixture.store.begin().await.unwrap();
    let mut first = async || retract::retract(&mut transaction, model_id, 1, now()).await.unwrap();
    assert_eq!(first().await, retract::Retracted::Done { events: 1, stopped: Vec::new() });
    assert_eq!(first().await, retract::Retracted::Before { replaying: None });
    transaction.commit().await.unwrap();
    let picture = fixture.picture(model_id).await;
    assert!(picture.ends_with("batch 1 retracted 1\nbatch 2 pending 2"), "{picture}");
}

#[tokio::test]
async fn a_task_that_waits_goes_on_without_what_was_retracted_or_not_at_all() {
    let (fixture, model_id) = fixture().await;
    fixture.batch(model_id, "slow", 0..8).await;
    fixture.batch(model_id, "slow", 10..14).await;
    fixture.batch(model_id, "fast", 20..23).await;
    fixture.tasks_of_pending(model_id).await;
    let mut transaction = fixture.store.begin().await.unwrap();
    for batch in [1, 3] {
        let retracted = retract::retract(&mut transaction, model_id, batch, now()).await.unwrap();
        assert!(matches!(retracted, retract::Retracted::Done { stopped, .. } if stopped.is_empty()));
    }
    transaction.commit().await.unwrap();
    let tasks = fixture.store.tasks(model_id, 0, 10).await.unwrap();
    let seen: Vec<_> = tasks.iter().map(|task| (task.state.as_str(), task.batches.clone())).collect();
    assert_eq!(seen, [("queued", vec![2]), ("cancelled", vec![])]);
    assert_eq!(fixture.store.training_events(1).await.unwrap().len(), 4);
}
