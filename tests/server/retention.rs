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

#[tokio::test]
async fn what_a_model_keeps_can_be_changed_and_the_audit_log_says_who_did() {
    let mut server = Server::start().await;
    server.close_gate().await;
    model(&server, "m", json!({})).await;
    for (stage, speed) in [14.0, 11.0, 8.0].into_iter().enumerate() {
        server.learn("m", &format!("r{stage}"), &events(&format!("s{stage}"), 16, speed)).await;
    }
    let before = server.get("/v1/models/m").await.expect(200);
    let change = |wish: Value| server.request(Method::PATCH, "/v1/models/m").json(&wish);
    for (wrong, code) in [
        (json!({}), "invalid_body"),
        (json!({"retention": {"versions": 1}, "hidden": 3}), "invalid_body"),
        (json!({"retention": null}), "invalid_settings"),
        (json!({"retention": []}), "invalid_settings"),
        (json!({"retention": {"versions": 0}}), "invalid_settings"),
        (json!({"retention": {"events_days": 3}}), "invalid_settings"),
    ] {
        server.send(change(wrong)).await.expect_problem(422, code);
    }
    let wish = json!({"retention": {"versions": 1}});
    let stale = change(wish.clone()).header("if-match", "\"1-1\"");
    server.send(stale).await.expect_problem(412, "precondition_failed");
    let trainer = server.make_key(&json!({"scopes": ["train"]})).await;
    server.send(change(wish.clone()).bearer_auth(&trainer)).await.expect_problem(403, "insufficient_scope");
    assert_eq!(server.get("/v1/models/m").await.text, before.text, "what is refused changes nothing");
    assert_eq!(server.get("/v1/models/m/versions/1").await["pruned"], false);

    let changed = server.send(change(wish).header("if-match", before.header("etag"))).await.expect(200);
    assert_eq!(changed["settings"]["retention"], json!({"events_s": null, "versions": 1}));
    assert_ne!(changed.header("etag"), before.header("etag"));
    until(&server, "/v1/models/m/versions/1", |found| found["pruned"] == true).await;
    // What was said before is gone as a whole.
    let changed = server.send(change(json!({"retention": {"events_s": 0}}))).await.expect(200);
    assert_eq!(changed["settings"]["retention"], json!({"events_s": 0, "versions": null}));
    until(&server, "/v1/models/m/batches/b1", |found| found["pruned_events"] != 0).await;
    let log = server.get("/v1/audit?model=m&page_size=1000").await.expect(200);
    let noted = log["audit"].as_array().unwrap().iter().filter(|entry| entry["action"] == "model.retain");
    let admin = &server.key.as_deref().unwrap()[3..19];
    let noted: Vec<_> = noted.map(|entry| (entry["actor"].as_str().unwrap(), &entry["detail"]["retention"])).collect();
    let said = [json!({"events_s": null, "versions": 1}), json!({"events_s": 0, "versions": null})];
    assert_eq!(noted, [(admin, &said[0]), (admin, &said[1])]);
    // A model whose retention changed is as whole as before, also for a process that starts anew, and goes on learning.
    let server = server.restart().await;
    server.learn("m", "r3", &events("s3", 16, 6.0)).await;
    server.stop().await;
}
