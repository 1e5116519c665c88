use reqwest::Method;
use serde_json::{Value, json};

use crate::support::events::{events, window};
use crate::support::server::Server;

async fn model(server: &Server, name: &str, settings: Value) {
    server.post("/v1/models", &json!({"model": name, "method": "ewc", "settings": settings})).await.expect(201);
}

async fn until(server: &Server, path: &str, reached: impl Fn(&Value) -> bool) {
    while !reached(&server.get(path).await.expect(200).body) {}
}

async fn weights(server: &Server, model: &str, version: i64) -> Value {
    server.get(&format!("/v1/models/{model}/versions/{version}")).await.expect(200)["weights_sha256"].clone()
}

#[tokio::test]
async fn old_versions_lose_their_weights_and_keep_lineage_and_measures() {
    let server = Server::start().await;
    model(&server, "m", json!({"retention": {"versions": 2}})).await;
    let path = |version: i64| format!("/v1/models/m/versions/{version}");
    let learned: Vec<_> = (0..5).map(|stage| events(&format!("s{stage}"), 16, 16.0 - 2.0 * f64::from(stage))).collect();
    for (stage, events) in learned.iter().enumerate() {
        server.learn("m", &format!("r{stage}"), events).await;
        if stage == 0 {
            let note = server.request(Method::PATCH, &path(1)).json(&json!({"note": "the first"}));
            server.send(note).await.expect(200);
        }
    }
    for version in [2, 3] {
        until(&server, &path(version), |found| found["pruned"] == true).await;
    }
    for version in [1, 4, 5] {
        assert_eq!(server.get(&path(version)).await["pruned"], false, "noted, the live version's parent, live");
    }
    let ask = |version: i64| json!({"version": version, "windows": [window(5, 11.0)]});
    server.post("/v1/models/m/predict", &ask(3)).await.expect_problem(410, "version_pruned");
    server.post("/v1/models/m/predict", &ask(1)).await.expect(200);
    for call in ["promote", "rollback"] {
        let wish = json!({"version": 3, "reason": "r"});
        server.post(&format!("/v1/models/m/{call}"), &wish).await.expect_problem(410, "version_pruned");
    }
    let evaluation = server.get(&format!("{}/evaluation", path(3))).await.expect(200);
    assert_eq!(evaluation["tasks"].as_array().unwrap().len(), 3);

    // Version 3 continues a pruned one: the line is learned again from version 1 on.
    let replay = server.send(server.request(Method::DELETE, "/v1/models/m/batches/b3")).await.expect(202);
    let ended = server.end_of("m", replay["task_id"].as_str().unwrap()).await;
    assert_eq!((&ended["state"], &ended["parent"], &ended["version"]), (&json!("succeeded"), &json!(1), &json!(8)));
    model(&server, "clean", json!({})).await;
    for stage in [0, 1, 3, 4] {
        server.learn("clean", &format!("r{stage}"), &learned[stage]).await;
    }
    assert_eq!(weights(&server, "m", 8).await, weights(&server, "clean", 4).await);
    server.stop().await;
}

#[tokio::test]
async fn old_events_lose_their_arrays_and_are_still_known() {
    let server = Server::start().await;
    model(&server, "m", json!({"retention": {"events_s": 0}})).await;
    let first = events("a", 16, 16.0);
    server.learn("m", "fast", &first).await;
    server.learn("m", "slow", &events("b", 16, 6.0)).await;
    for batch in ["b1", "b2"] {
        until(&server, &format!("/v1/models/m/batches/{batch}"), |found| found["pruned_events"] == 12).await;
    }
    let delete = |batch: &str| server.request(Method::DELETE, &format!("/v1/models/m/batches/{batch}"));
    server.send(delete("b1")).await.expect_problem(409, "events_pruned");
    let read = server.get("/v1/models/m/batches/b1").await.expect(200);
    assert_eq!((&read["events"]["learned"], &read["retracted_at"]), (&json!(16), &json!(null)), "nothing was changed");
    assert_eq!(server.upload("m", "", &first).await.expect(201)["duplicates"], 16);
    assert_eq!(server.learn("m", "middle", &events("c", 16, 11.0)).await, 3);
    let evaluation = server.get("/v1/models/m/versions/3/evaluation").await.expect(200);
    assert_eq!(evaluation["tasks"][0]["events"], 4, "events for tests are whole");
    // Where nothing else has to be learned again, nothing else is needed.
    server.post("/v1/models/m/rollback", &json!({"version": 2, "reason": "r"})).await.expect(200);
    server.send(delete("b3")).await.expect(200);
    for batch in ["b2", "b1"] {
        let replay = server.send(delete(batch)).await.expect(202);
        assert_eq!(server.end_of("m", replay["task_id"].as_str().unwrap()).await["state"], "succeeded");
    }
    assert_eq!(server.get("/v1/models/m").await["head"], json!(null));
    server.stop().await;
}

#[tokio::test]
async fn a_database_beyond_its_budget_drops_arrays_but_of_models_that_go_back_to_them() {
    let server = Server::start_with("[upkeep]\nbudget_bytes = 1").await;
    server.post("/v1/models", &json!({"model": "joint", "method": "joint"})).await.expect(201);
    model(&server, "m", json!({})).await;
    for name in ["joint", "m"] {
        server.learn(name, "fast", &events("a", 16, 16.0)).await;
    }
    until(&server, "/v1/models/m/batches/b2", |found| found["pruned_events"] == 12).await;
    assert_eq!(server.get("/v1/models/joint/batches/b1").await["pruned_events"], 0);
    server.stop().await;
}
