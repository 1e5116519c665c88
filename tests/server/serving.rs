use reqwest::Method;
use serde_json::{Value, json};

use crate::support::events::events;
use crate::support::server::Server;

const PROMOTE: &str = "/v1/models/default/promote";
const ROLLBACK: &str = "/v1/models/default/rollback";

async fn two_versions() -> Server {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    server.learn("default", "slow", &events("f", 12, 6.0)).await;
    server
}

async fn pointers(server: &Server) -> (Value, Value) {
    let model = server.get("/v1/models/default").await.expect(200);
    (model["live"].clone(), model["head"].clone())
}

async fn served_version(server: &Server) -> Value {
    let body = json!({"windows": [crate::support::events::window(5, 10.0)]});
    server.post("/v1/models/default/predict", &body).await.expect(200)["version"].clone()
}

#[tokio::test]
async fn promote_moves_live_and_rollback_moves_head_too() {
    let server = two_versions().await;
    let promoted = server.post(PROMOTE, &json!({"version": 1, "reason": "a test"})).await.expect(200);
    assert_eq!((&promoted["live"], &promoted["head"], &promoted["from"]), (&json!(1), &json!(2), &json!(2)));
    assert_eq!(served_version(&server).await, 1);
    server.post(PROMOTE, &json!({"version": 2, "reason": "back"})).await.expect(200);
    let rolled = server.post(ROLLBACK, &json!({"reason": "worse in the rain"})).await.expect(200);
    assert_eq!((&rolled["live"], &rolled["head"], &rolled["from"]), (&json!(1), &json!(1), &json!(2)));
    assert_eq!((pointers(&server).await, served_version(&server).await), ((json!(1), json!(1)), json!(1)));
    server.post(ROLLBACK, &json!({"reason": "again"})).await.expect_problem(409, "no_parent_version");
    server.post(ROLLBACK, &json!({"version": 9, "reason": "x"})).await.expect_problem(404, "version_not_found");
    let history = server.get("/v1/models/default/history").await.expect(200);
    let actions: Vec<_> = history["history"].as_array().unwrap().iter().map(|entry| entry["action"].clone()).collect();
    assert_eq!(actions, ["policy", "policy", "promote", "promote", "rollback"]);
    let last = &history["history"][4];
    assert_eq!((&last["history_id"], &last["reason"]), (&rolled["history_id"], &json!("worse in the rain")));
    server.stop().await;
}

#[tokio::test]
async fn after_a_rollback_abandoned_events_are_set_aside_and_learning_is_as_if_they_had_never_been() {
    let server = two_versions().await;
    assert_eq!(server.learn("default", "wet", &events("h", 12, 9.0)).await, 3);
    server.post(ROLLBACK, &json!({"version": 1, "reason": "undo"})).await.expect(200);
    for batch in ["b2", "b3"] {
        assert_eq!(server.get(&format!("/v1/models/default/batches/{batch}")).await["events"]["set_aside"], 12);
    }
    let fourth = events("g", 12, 11.0);
    assert_eq!(server.learn("default", "middle", &fourth).await, 4);
    server.post("/v1/models", &json!({"model": "twin", "method": "ewc"})).await.expect(201);
    server.learn("twin", "fast", &events("e", 12, 16.0)).await;
    assert_eq!(server.learn("twin", "middle", &fourth).await, 2);
    let here = server.get("/v1/models/default/versions/4").await;
    let there = server.get("/v1/models/twin/versions/2").await;
    assert_eq!((&here["weights_sha256"], &here["stage"]), (&there["weights_sha256"], &json!(2)));
    let here = server.get("/v1/models/default/versions/4/evaluation").await;
    let there = server.get("/v1/models/twin/versions/2/evaluation").await;
    assert_eq!(here["measures"], there["measures"]);
    server.stop().await;
}

#[tokio::test]
async fn what_is_replayed_rolls_back_with_the_line() {
    let server = Server::start().await;
    for (model, method) in [("m", "replay_ewc"), ("twin", "replay_ewc"), ("plain", "ewc")] {
        let wish = json!({"model": model, "method": method, "settings": {"replay_events": 5}});
        assert_eq!(server.post("/v1/models", &wish).await.expect(201)["method"], method);
    }
    let (first, fourth) = (events("e", 12, 16.0), events("g", 12, 11.0));
    server.learn("m", "fast", &first).await;
    server.learn("m", "slow", &events("f", 12, 6.0)).await;
    server.learn("m", "wet", &events("h", 12, 9.0)).await;
    server.post("/v1/models/m/rollback", &json!({"version": 1, "reason": "undo"})).await.expect(200);
    server.learn("m", "middle", &fourth).await;
    for model in ["twin", "plain"] {
        server.learn(model, "fast", &first).await;
        server.learn(model, "middle", &fourth).await;
    }
    let rolled = server.get("/v1/models/m/versions/4").await.expect(200);
    let direct = server.get("/v1/models/twin/versions/2").await.expect(200);
    assert_eq!((&rolled["weights_sha256"], &rolled["events"]), (&direct["weights_sha256"], &json!(9)));
    let plain = server.get("/v1/models/plain/versions/2").await.expect(200);
    assert_ne!(rolled["weights_sha256"], plain["weights_sha256"], "something was replayed");
    server.stop().await;
}

#[tokio::test]
async fn a_rollback_cancels_what_waits() {
    let server = two_versions().await;
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "", &events("g", 8, 9.0)).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    let rolled = server.post(ROLLBACK, &json!({"reason": "undo"})).await.expect(200);
    assert_eq!(rolled["cancelled"], json!(["t3"]));
    assert_eq!(server.get("/v1/models/default/tasks/t3").await["state"], "cancelled");
    server.stop().await;
}

#[tokio::test]
async fn if_match_guards_a_move() {
    let server = two_versions().await;
    let etag = server.get("/v1/models/default").await.header("etag").to_owned();
    let promote = |etag: &str| {
        server.request(Method::POST, PROMOTE).header("if-match", etag).json(&json!({"version": 1, "reason": "a test"}))
    };
    let moved = server.send(promote(&etag)).await.expect(200);
    assert_ne!(moved.header("etag"), etag);
    server.send(promote(&etag)).await.expect_problem(412, "precondition_failed");
    let rollback =
        server.request(Method::POST, ROLLBACK).header("if-match", &etag).json(&json!({"version": 1, "reason": "late"}));
    server.send(rollback).await.expect_problem(412, "precondition_failed");
    server.send(promote(moved.header("etag"))).await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn a_move_needs_a_reason_and_is_made_once_per_key() {
    let server = two_versions().await;
    server.post(PROMOTE, &json!({"version": 1})).await.expect_problem(422, "invalid_body");
    let empty = server.post(PROMOTE, &json!({"version": 1, "reason": ""})).await.expect_problem(422, "invalid_body");
    assert_eq!(empty["errors"][0]["pointer"], "/reason");
    let undo = json!({"reason": "undo"});
    let first = server.post_with_key(ROLLBACK, "k", &undo).await.expect(200);
    assert_eq!(server.post_with_key(ROLLBACK, "k", &undo).await.expect(200).text, first.text);
    assert_eq!(pointers(&server).await, (json!(1), json!(1)));
    server.stop().await;
}

#[tokio::test]
async fn a_version_that_is_worse_is_kept_with_the_reason_and_learning_goes_on_from_it() {
    let server = Server::start_with("[model]\npromotion = \"gated\"\nepochs = 60").await;
    server.post("/v1/models", &json!({"model": "m", "method": "naive"})).await.expect(201);
    server.learn("m", "fast", &events("e", 12, 16.0)).await;
    server.upload("m", "?regime=slow", &events("f", 12, 3.0)).await.expect(201);
    // So quick that what was known is lost.
    let quick = json!({"batches": "pending", "settings": {"learning_rate": 0.02}});
    server.post("/v1/models/m/tasks", &quick).await.expect(202);
    let ended = server.end_of("m", "t2").await;
    assert_eq!(ended["state"], "succeeded", "{}", ended.text);
    let model = server.get("/v1/models/m").await.expect(200);
    assert_eq!((&model["live"], &model["head"]), (&json!(1), &json!(2)));
    let promotion = server.get("/v1/models/m/versions/2").await.expect(200)["promotion"].clone();
    assert_eq!((&promotion["policy"], &promotion["decision"]), (&json!("gated"), &json!("kept")));
    assert!(promotion["reason"].as_str().unwrap().contains("fast"), "{promotion}");
    server.post("/v1/models/m/promote", &json!({"version": 2, "reason": "all the same"})).await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn with_a_manual_policy_nothing_serves_until_it_is_promoted() {
    let server = Server::start_with("[model]\npromotion = \"manual\"").await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    assert_eq!(pointers(&server).await, (json!(null), json!(1)));
    let windows = json!({"windows": [crate::support::events::window(5, 10.0)]});
    server.post("/v1/models/default/predict", &windows).await.expect_problem(409, "no_live_version");
    server.post(PROMOTE, &json!({"version": 1, "reason": "looked at it"})).await.expect(200);
    assert_eq!(served_version(&server).await, 1);
    server.stop().await;
}
