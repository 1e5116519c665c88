use reqwest::Method;
use serde_json::{Value, json};

use crate::support::events::{events, window};
use crate::support::server::{Answer, Server};

async fn model(server: &Server, name: &str, method: &str) {
    server.post("/v1/models", &json!({"model": name, "method": method})).await.expect(201);
}

async fn retract(server: &Server, model: &str, batch: &Value) -> Answer {
    let path = format!("/v1/models/{model}/batches/{}", batch.as_str().unwrap());
    server.send(server.request(Method::DELETE, &path)).await
}

/// Retracts what was learned and waits for the replay.
async fn replayed(server: &Server, model: &str, batch: &Value) -> Answer {
    let replay = retract(server, model, batch).await.expect(202);
    assert_eq!(
        (&replay["kind"], &replay["version"], &replay["report"]),
        (&json!("replay"), &json!(null), &json!(null))
    );
    let id = replay["task_id"].as_str().unwrap();
    assert_eq!(replay.header("location"), format!("/v1/models/{model}/tasks/{id}"));
    let ended = server.end_of(model, id).await;
    assert_eq!((&ended["state"], &ended["progress"]), (&json!("succeeded"), &json!(1.0)), "{}", ended.text);
    ended
}

async fn weights(server: &Server, model: &str, version: &Value) -> Value {
    server.get(&format!("/v1/models/{model}/versions/{version}")).await.expect(200)["weights_sha256"].clone()
}

async fn batch_of(server: &Server, model: &str, place: usize) -> Value {
    server.get(&format!("/v1/models/{model}/batches")).await.expect(200)["batches"][place]["batch_id"].clone()
}

#[tokio::test]
async fn the_head_after_a_replay_has_the_bits_of_a_model_that_never_saw_the_batch() {
    let server = Server::start().await;
    let (a, b, c) = (events("a", 16, 16.0), events("b", 16, 11.0), events("c", 16, 6.0));
    for method in ["ewc", "joint", "replay"] {
        model(&server, method, method).await;
        for (regime, events) in [("fast", &a), ("middle", &b), ("slow", &c)] {
            server.learn(method, regime, events).await;
        }
        let ended = replayed(&server, method, &batch_of(&server, method, 1).await).await;
        assert_eq!((&ended["version"], &ended["parent"]), (&json!(4), &json!(1)), "{}", ended.text);
        let clean = format!("{method}-clean");
        model(&server, &clean, method).await;
        server.learn(&clean, "fast", &a).await;
        server.learn(&clean, "slow", &c).await;
        assert_eq!(weights(&server, method, &json!(4)).await, weights(&server, &clean, &json!(2)).await);
        let found = server.get(&format!("/v1/models/{method}")).await.expect(200);
        assert_eq!((&found["live"], &found["head"]), (&json!(4), &json!(4)));
        let evaluation = |model: String, version| {
            let server = &server;
            async move { server.get(&format!("/v1/models/{model}/versions/{version}/evaluation")).await["measures"].clone() }
        };
        assert_eq!(evaluation(method.to_owned(), 4).await, evaluation(clean, 2).await);
    }
    server.stop().await;
}

#[tokio::test]
async fn a_replay_reports_before_and_after_on_every_regime_as_a_task_and_in_the_history() {
    let server = Server::start().await;
    for (regime, speed) in [("fast", 16.0), ("middle", 11.0), ("slow", 6.0)] {
        server.learn("default", regime, &events(regime, 16, speed)).await;
    }
    let ended = replayed(&server, "default", &json!("b2")).await;
    let report = &ended["report"];
    assert_eq!((&report["before"], &report["after"]), (&json!(3), &json!(4)));
    assert_eq!(
        report["stages"],
        json!([{"version": 2, "regime": "middle", "replayed_as": null}, {"version": 3, "regime": "slow", "replayed_as": 4}])
    );
    let seen: Vec<_> = report["regimes"].as_array().unwrap().iter().map(|it| (&it["regime"], &it["events"])).collect();
    assert_eq!(seen, [(&json!("fast"), &json!(4)), (&json!("slow"), &json!(4)), (&json!("middle"), &json!(0))]);
    for side in ["before", "after"] {
        assert!(report["regimes"][0][side]["spacing_mse"].as_f64().unwrap() > 0.0, "{}", ended.text);
    }
    let history = server.get("/v1/models/default/history").await.expect(200);
    let moves: Vec<_> = history["history"].as_array().unwrap().iter().rev().take(2).collect();
    assert_eq!(
        (&moves[1]["action"], &moves[1]["from_head"], &moves[1]["head"]),
        (&json!("retract"), &json!(3), &json!(1))
    );
    assert_eq!((&moves[0]["action"], &moves[0]["from"], &moves[0]["live"]), (&json!("replay"), &json!(3), &json!(4)));
    assert_eq!(&moves[0]["report"], report);
    let part =
        server.get(&format!("/v1/models/default/tasks/{}", ended["parts"][0].as_str().unwrap())).await.expect(200);
    assert_eq!((&part["kind"], &part["part_of"], &part["replays"]), (&json!("learn"), &ended["task_id"], &json!(3)));
    assert_eq!((&part["version"], &part["batches"]), (&json!(4), &json!(["b3"])));
    server.stop().await;
}

#[tokio::test]
async fn tainted_versions_are_marked_and_serve_only_when_somebody_insists() {
    let server = Server::start().await;
    for (regime, speed) in [("fast", 16.0), ("slow", 6.0)] {
        server.learn("default", regime, &events(regime, 16, speed)).await;
    }
    replayed(&server, "default", &json!("b2")).await;
    let list = server.get("/v1/models/default/versions").await.expect(200);
    let tainted: Vec<_> = list["versions"].as_array().unwrap().iter().map(|version| &version["tainted"]).collect();
    assert_eq!(tainted, [&json!(false), &json!(true)]);
    let (plain, forced) = (json!({"version": 2, "reason": "r"}), json!({"version": 2, "reason": "r", "force": true}));
    for call in ["promote", "rollback"] {
        let path = format!("/v1/models/default/{call}");
        server.post(&path, &plain).await.expect_problem(409, "version_tainted");
        assert_eq!(server.post(&path, &forced).await.expect(200)["live"], 2);
    }
    let metrics = server.get("/metrics").await.expect(200).text;
    assert!(metrics.contains("headway_live_version_tainted{model=\"default\"} 1"), "{metrics}");
    server.stop().await;
}

#[tokio::test]
async fn with_everything_retracted_nothing_serves_and_the_content_may_come_anew() {
    let server = Server::start().await;
    let uploaded = events("e", 16, 16.0);
    server.learn("default", "fast", &uploaded).await;
    let before = weights(&server, "default", &json!(1)).await;
    let ended = replayed(&server, "default", &json!("b1")).await;
    assert_eq!((&ended["version"], &ended["report"]["after"]), (&json!(null), &json!(null)));
    let found = server.get("/v1/models/default").await.expect(200);
    assert_eq!((&found["live"], &found["head"]), (&json!(null), &json!(null)));
    let ask = json!({"windows": [window(5, 11.0)]});
    server.post("/v1/models/default/predict", &ask).await.expect_problem(409, "no_live_version");
    assert_eq!(server.learn("default", "fast", &uploaded).await, 2);
    assert_eq!(weights(&server, "default", &json!(2)).await, before);
    retract(&server, "default", &json!("b1")).await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn a_batch_of_a_task_that_waits_leaves_it() {
    let server = Server::start().await;
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    for kind in ["e", "f"] {
        server.upload("default", "", &events(kind, 8, 8.0)).await.expect(201);
    }
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    retract(&server, "default", &json!("b1")).await.expect(200);
    server.post("/v1/models/default/resume", &json!({})).await.expect(200);
    let ended = server.end_of("default", "t1").await;
    assert_eq!((&ended["state"], &ended["batches"]), (&json!("succeeded"), &json!(["b2"])), "{}", ended.text);
    assert_eq!(server.get("/v1/models/default/versions/1").await["events"], 6);
    server.stop().await;
}

#[tokio::test]
async fn a_replay_that_is_cancelled_ends_with_its_parts() {
    let server = Server::start().await;
    for (regime, speed) in [("fast", 16.0), ("slow", 6.0)] {
        server.learn("default", regime, &events(regime, 16, speed)).await;
    }
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    let replay = retract(&server, "default", &json!("b1")).await.expect(202);
    assert_eq!(retract(&server, "default", &json!("b1")).await.expect(202).body, replay.body, "it is under way");
    let path = |id: &Value| format!("/v1/models/default/tasks/{}", id.as_str().unwrap());
    server.post(&format!("{}/cancel", path(&replay["task_id"])), &json!({})).await.expect(200);
    for id in [&replay["task_id"], &replay["parts"][0]] {
        assert_eq!(server.get(&path(id)).await["state"], "cancelled");
    }
    server.post("/v1/models/default/resume", &json!({})).await.expect(200);
    let found = server.get("/v1/models/default").await.expect(200);
    assert_eq!((&found["live"], &found["head"]), (&json!(2), &json!(null)));
    assert_eq!(server.get("/v1/models/default/batches/b2").await["events"]["set_aside"], 16);
    retract(&server, "default", &json!("b1")).await.expect(200);
    server.stop().await;
}
