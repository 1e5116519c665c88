use serde_json::{Value, json};

use crate::support::events::events;
use crate::support::server::{Answer, Server};

const SETTINGS: &str = "[ingest.sources]\nwindow = 8\nmin_events = 4";

/// `good` events that may be learned and `bad` ones whose follower jumps.
fn mixed(kind: &str, good: usize, bad: usize) -> Vec<Value> {
    let mut all = events(kind, good + bad, 12.0);
    for event in &mut all[good..] {
        event["follower_speed_mps"][20] = json!(60.0);
    }
    all
}

async fn source(server: &Server, at: usize) -> Value {
    server.get("/v1/models/default/sources").await.expect(200)["sources"][at].clone()
}

async fn counts(server: &Server, batch: &str) -> Value {
    server.get(&format!("/v1/models/default/batches/{batch}")).await.expect(200)["events"].clone()
}

async fn learn(server: &Server, batches: Value) -> Answer {
    server.post("/v1/models/default/tasks", &json!({"batches": batches})).await
}

#[tokio::test]
async fn a_source_that_keeps_failing_is_held_until_it_is_released() {
    let server = Server::start_with(SETTINGS).await;
    let first = server.upload("default", "?source=site", &mixed("a", 4, 3)).await.expect(201);
    assert_eq!((&first["rejected_count"], &first["held_sources"]), (&json!(3), &json!([])), "{}", first.text);
    let second = server.upload("default", "?source=site", &mixed("b", 1, 3)).await.expect(201);
    assert_eq!(second["held_sources"], json!(["site"]));
    let held = source(&server, 0).await;
    assert_eq!((&held["source"], &held["held"], &held["held_events"]), (&json!("site"), &json!(true), &json!(5)));
    assert_eq!((&held["checked_events"], &held["failed_events"]), (&json!(8), &json!(6)), "{held}");
    assert_eq!(held["reason"], "6 of its last 8 events failed the checks");
    let later = server.upload("default", "?source=site", &mixed("c", 6, 0)).await.expect(201);
    assert_eq!(
        (&later["accepted"], &later["held_sources"]),
        (&json!(6), &json!(["site"])),
        "it is stored all the same"
    );
    for (batch, events) in [("b1", 4), ("b2", 1), ("b3", 6)] {
        assert_eq!(counts(&server, batch).await["held"], events);
    }
    let metrics = server.get("/metrics").await.expect(200).text;
    assert!(metrics.contains("headway_sources_held{model=\"default\"} 1"), "{metrics}");
    // Nothing of it is learned, not even when it is named; others are.
    server.upload("default", "?source=other", &events("d", 8, 9.0)).await.expect(201);
    learn(&server, json!(["b1", "b3"])).await.expect_problem(409, "nothing_pending");
    let task = learn(&server, json!("pending")).await.expect(202);
    server.end_of("default", task["task_id"].as_str().unwrap()).await;
    assert_eq!(server.get("/v1/models/default/versions/1").await["events"], 6);

    let released = server.post("/v1/models/default/sources/site/release", &json!({})).await.expect(200);
    assert_eq!(
        (&released["held"], &released["released_events"], &released["held_events"]),
        (&json!(false), &json!(11), &json!(0))
    );
    assert_eq!((&released["checked_events"], &released["task_ids"]), (&json!(0), &json!([])));
    let again = server.post("/v1/models/default/sources/site/release", &json!({})).await.expect(200);
    assert_eq!(again["released_events"], 0);
    learn(&server, json!("pending")).await.expect(202);
    assert_eq!(counts(&server, "b3").await["held"], 0);
    server.stop().await;
}

#[tokio::test]
async fn sources_are_judged_by_themselves_and_named_as_uploads_name_them() {
    let server = Server::start_with(SETTINGS).await;
    let mut both = mixed("a", 6, 6);
    for event in &mut both[6..] {
        event["source"] = json!("site 12/north");
    }
    let uploaded = server.upload("default", "?source=good", &both).await.expect(201);
    assert_eq!(uploaded["held_sources"], json!(["site 12/north"]));
    assert_eq!(counts(&server, "b1").await["pending"], 6);
    // Without a source, nothing is judged.
    assert_eq!(server.upload("default", "", &mixed("b", 1, 9)).await.expect(201)["held_sources"], json!([]));
    let released = server.post("/v1/models/default/sources/site%2012%2Fnorth/release", &json!({})).await.expect(200);
    assert_eq!(released["source"], "site 12/north");
    server.post("/v1/models/default/sources/nowhere/release", &json!({})).await.expect_problem(404, "source_not_found");
    server.stop().await;
}
