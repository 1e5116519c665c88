//! What is not what was written: nothing is learned from it, and the task says which.

use super::*;
use crate::car_following::Event;
use crate::lineage::{RegimeName, Split, TaskError};
use crate::store::batch::{self, NewBatch};
use crate::store::event::{self, Link, NewEvent};

async fn error(engine: &Engine, model_id: i64, task_id: i64) -> TaskError {
    engine.fixture.store.task(model_id, task_id).await.unwrap().unwrap().error.expect("it failed")
}

/// Uploads events of these marks once more.
async fn upload(engine: &Engine, model_id: i64, marks: std::ops::Range<u16>) -> Vec<Link> {
    let mut transaction = engine.fixture.store.begin().await.unwrap();
    let new = NewBatch {
        model_id,
        source: None,
        regime: None,
        content_type: "application/json".to_owned(),
        body_sha256: [0; 32],
        body_bytes: 0,
        created_at: clock(),
    };
    let batch_id = batch::begin(&mut transaction, &new).await.unwrap();
    let arriving = |mark| {
        let event: Event = fixture::event(mark);
        NewEvent {
            name: format!("again {mark}"),
            source: None,
            run: None,
            split: Split::Train,
            regime: RegimeName::parse("again").unwrap(),
            content_sha256: event.content_sha256(),
            event,
            held: false,
        }
    };
    let arriving: Vec<_> = marks.map(arriving).collect();
    let links = event::store(&mut transaction, model_id, batch_id, &arriving, clock()).await.unwrap();
    event::link(&mut transaction, batch_id, 0, &links).await.unwrap();
    transaction.commit().await.unwrap();
    links
}

#[tokio::test]
async fn a_task_with_a_corrupt_event_fails_and_names_it_and_an_upload_of_its_content_mends_it() {
    let (engine, sound) = (Engine::new(Script::default()).await, Engine::new(Script::default()).await);
    let model_id = engine.model("m").await;
    let batch_id = engine.fixture.batch(model_id, "fast", 0..10).await;
    engine.fixture.tasks_of(model_id, &[batch_id]).await;
    engine.fixture.execute("update event set arrays = zeroblob(length(arrays)) where name = 'e3'").await;
    engine.drain().await;
    let told = error(&engine, model_id, 1).await;
    assert_eq!(told.code, "corrupt_event");
    assert!(told.detail.starts_with("event e3 of batch b1 is corrupt"), "{}", told.detail);
    assert!(engine.fixture.picture(model_id).await.ends_with("batch 1 held 10"));
    let links = upload(&engine, model_id, 2..5).await;
    assert!(links.iter().all(|link| link.duplicate), "what is mended is known all the same: {links:?}");
    assert!(engine.fixture.picture(model_id).await.ends_with("batch 1 held 10"), "and stays where it was");
    engine.fixture.tasks_of(model_id, &[batch_id]).await;
    engine.drain().await;
    let other = sound.model("m").await;
    sound.learn(other, "fast", 0).await;
    assert_eq!(engine.weights_sha256(model_id, 1).await, sound.weights_sha256(other, 1).await);
}

#[tokio::test]
async fn nothing_is_learned_from_a_corrupt_head_until_a_rollback() {
    for (part, code) in [
        ("update weights set weights = zeroblob(length(weights)) where version = 2", "corrupt_version"),
        ("update version set lambda = 7 where version = 2", "corrupt_version"),
        ("update version_regime set test_steps = test_steps + 1 where version = 2", "corrupt_version"),
        (
            "update anchor set importance = zeroblob(length(importance)) where anchor_id = (select max(anchor_id) from anchor)",
            "corrupt_anchor",
        ),
        (
            "update reservoir set event_ids = zeroblob(16) where reservoir_id = (select max(reservoir_id) from reservoir)",
            "corrupt_reservoir",
        ),
    ] {
        let engine = Engine::new(Script::default()).await;
        let model_id = engine.model("m").await;
        engine.learn(model_id, "fast", 0).await;
        engine.learn(model_id, "slow", 10).await;
        engine.fixture.execute(part).await;
        let task_id = engine.learn(model_id, "jam", 20).await;
        let told = error(&engine, model_id, task_id).await;
        assert_eq!(told.code, code, "{part}: {}", told.detail);
        assert!(told.detail.contains("roll back"), "{}", told.detail);
        engine.rollback(model_id, 1).await;
        engine.fixture.tasks_of(model_id, &[3]).await;
        engine.drain().await;
        assert!(engine.fixture.picture(model_id).await.starts_with("live 3 head 3\n"), "{part}");
    }
}

#[tokio::test]
async fn a_model_whose_settings_are_not_its_own_learns_nothing() {
    let fixture = Fixture::new().await;
    let model_id = fixture.model("m", Method::Ewc, &model_settings()).await;
    let engine = Engine::on(fixture.reopened().await, Script::default(), clock).await;
    engine.fixture.execute("update model set settings = replace(settings, '0.004', '0.104')").await;
    let task_id = engine.learn(model_id, "fast", 0).await;
    assert_eq!(error(&engine, model_id, task_id).await.code, "corrupt_model");
}
