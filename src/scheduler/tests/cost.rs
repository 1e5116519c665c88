//! What a task costs when there have been many.

use super::*;

#[tokio::test]
async fn the_hundredth_task_writes_as_many_rows_as_the_second() {
    let engine = Engine::new(Script::default()).await;
    let settings = ModelSettings { test_reservoir: 5, ..model_settings() };
    let model_id = engine.fixture.model("m", Method::Ewc, &settings).await;
    engine.learn(model_id, "fast", 0).await;
    let mut rows = vec![engine.fixture.rows().await];
    for task in 1..100 {
        engine.learn(model_id, "fast", task * 10).await;
        rows.push(engine.fixture.rows().await);
    }
    let written: Vec<i64> = rows.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(written.iter().all(|&n| n == written[0]), "{written:?}");
    let log = engine.fake.log();
    let last = &log[log.len() - 3..];
    assert_eq!(
        last,
        ["fast stage 100 from update 0, 7 events, keeps [fast]", "drive 5 events", "drive 5 events"],
        "neither the test events nor what is kept grows"
    );
}
