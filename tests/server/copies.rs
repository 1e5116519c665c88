//! Models that begin where others are.

use std::path::PathBuf;

use headway::store::verify::verify;
use reqwest::Method;
use serde_json::{Value, json};

use crate::lived::execute;
use crate::support::events::{event, events, window};
use crate::support::server::{Answer, Server};

/// Every method, and other ways for anchors to add up.
pub(crate) fn lines() -> Vec<(String, &'static str, Value)> {
    let methods = ["naive", "joint", "ewc", "mas", "si", "replay", "replay_ewc", "replay_mas"];
    let plain = methods.map(|method| (method.to_owned(), method, json!({})));
    let online = ["ewc", "mas", "si"]
        .map(|method| (format!("{method}-online"), method, json!({"accumulation": "online", "online_decay": 0.7})));
    plain.into_iter().chain(online).collect()
}

/// A batch of a regime, with events on every side.
pub(crate) fn batch(name: &str, speed: f64) -> Vec<Value> {
    let mut batch = events(name, 14, speed);
    batch.push(event(&format!("{name} to validate"), speed + 0.3, "validation"));
    batch.push(event(&format!("{name} to test"), speed + 0.6, "test"));
    batch
}

pub(crate) async fn begin(server: &Server, model: &str, method: &str, settings: &Value) {
    let body = json!({"model": model, "method": method, "settings": settings});
    server.post("/v1/models", &body).await.expect(201);
    for (regime, speed) in [("fast", 16.0), ("middle", 11.0)] {
        server.learn(model, regime, &batch(regime, speed)).await;
    }
}

pub(crate) async fn fork(server: &Server, name: &str, method: &str, of: &str, version: i64) -> Answer {
    let body = json!({"model": name, "method": method, "from": {"model": of, "version": version}});
    server.post("/v1/models", &body).await
}

async fn retract(server: &Server, model: &str, place: usize) -> Value {
    let batches = server.get(&format!("/v1/models/{model}/batches")).await.expect(200);
    let path = format!("/v1/models/{model}/batches/{}", batches["batches"][place]["batch_id"].as_str().unwrap());
    let replay = server.send(server.request(Method::DELETE, &path)).await.expect(202);
    server.end_of(model, replay["task_id"].as_str().unwrap()).await["version"].clone()
}

/// Everything that tells what a version learned and how it drives, but what differs between copies by its nature.
async fn told(server: &Server, model: &str, version: i64) -> Value {
    let path = format!("/v1/models/{model}/versions/{version}");
    let seen = server.get(&path).await.expect(200);
    let mut evaluation = server.get(&format!("{path}/evaluation")).await.expect(200).body;
    evaluation["model"].take();
    let mut told = json!({"evaluation": evaluation});
    for name in ["version", "parent", "stage", "regime", "method", "strength", "lambda", "weights_sha256", "events"] {
        told[name] = seen[name].clone();
    }
    let windows = json!({"windows": [window(5, 10.0), window(5, 15.0)], "version": version});
    let predicted = server.post(&format!("/v1/models/{model}/predict"), &windows).await.expect(200);
    told["predictions"] = predicted["predictions"].clone();
    told
}

/// What a model tells of itself while everything is asked of it: the next batch, what it learned before once more, a
/// retraction, a rollback.
pub(crate) async fn went_on(server: &Server, model: &str) -> Vec<Value> {
    let mut steps = vec![told(server, model, 1).await, told(server, model, 2).await];
    server.learn(model, "slow", &batch("slow", 6.0)).await;
    steps.push(told(server, model, 3).await);
    let again = server.upload(model, "?regime=fast", &batch("fast", 16.0)).await.expect(201);
    assert_eq!((&again["accepted"], &again["duplicates"]), (&json!(0), &json!(16)));
    let replayed = retract(server, model, 1).await;
    assert_eq!(replayed, 4);
    steps.push(told(server, model, 4).await);
    assert_eq!(server.get(&format!("/v1/models/{model}/versions/3")).await["tainted"], true);
    let back = json!({"version": 1, "reason": "tried"});
    server.post(&format!("/v1/models/{model}/rollback"), &back).await.expect(200);
    server.learn(model, "slower", &batch("slower", 4.0)).await;
    steps.push(told(server, model, 5).await);
    steps
}

/// Both go on alike, whatever is asked of them.
pub(crate) async fn go_on_alike(one: (&Server, &str), other: (&Server, &str)) {
    assert_eq!(went_on(one.0, one.1).await, went_on(other.0, other.1).await, "{}", one.1);
}

fn database(server: &Server) -> PathBuf {
    server.directory.path().join("headway.db")
}

pub(crate) async fn sound(server: Server) {
    let directory = server.stop().await;
    let found = verify(&directory.path().join("headway.db"), &|_| ()).await.unwrap();
    assert_eq!(found.faults, []);
}

#[tokio::test]
async fn a_fork_goes_on_as_its_model_would_whatever_the_method() {
    let server = Server::start().await;
    for (name, method, settings) in lines() {
        begin(&server, &name, method, &settings).await;
        let forked = format!("{name}-fork");
        let made = fork(&server, &forked, method, &name, 2).await.expect(201);
        assert_eq!((&made["live"], &made["head"]), (&json!(2), &json!(2)));
        go_on_alike((&server, &name), (&server, &forked)).await;
    }
    sound(server).await;
}

#[tokio::test]
async fn a_fork_holds_the_line_of_its_version_and_nothing_else() {
    let server = Server::start().await;
    begin(&server, "a", "ewc", &json!({})).await;
    server.upload("a", "?regime=waiting", &batch("waiting", 8.0)).await.expect(201);
    // The second batch brings what the first had, and one event of its own that is learned later.
    let mut mixed = batch("fast", 16.0);
    mixed.push(event("later", 9.0, "train"));
    server.upload("a", "?regime=waiting", &mixed).await.expect(201);
    server.post("/v1/models/a/rollback", &json!({"version": 1, "reason": "tried"})).await.expect(200);
    let made = fork(&server, "b", "ewc", "a", 1).await.expect(201);
    assert_eq!(made.header("location"), "/v1/models/b");
    let versions = server.get("/v1/models/b/versions").await;
    assert_eq!(versions["versions"].as_array().unwrap().len(), 1);
    let batches = server.get("/v1/models/b/batches").await;
    let of = |place: usize, what: &str| batches["batches"][place][what].clone();
    assert_eq!((of(0, "accepted"), of(1, "accepted"), of(1, "duplicates")), (json!(16), json!(0), json!(16)));
    assert_eq!(batches["batches"].as_array().unwrap().len(), 2);
    let history = server.get("/v1/models/b/history").await;
    let entry = &history["history"][0];
    assert_eq!((&entry["reason"], &entry["live"]), (&json!("forked from a, version 1"), &json!(1)));
    let audit = server.get("/v1/audit?model=b").await;
    let noted = audit["audit"].as_array().unwrap();
    assert_eq!(noted.len(), 1, "{noted:?}");
    assert_eq!((&noted[0]["action"], &noted[0]["detail"]["from"]), (&json!("model.fork"), &json!("a, version 1")));
    // The version that was abandoned can be forked as well: what it learned is learned there.
    fork(&server, "c", "ewc", "a", 2).await.expect(201);
    assert_eq!(told(&server, "c", 2).await, told(&server, "a", 2).await);
    // A retraction reaches neither of the others.
    let held = format!("/v1/models/b/batches/{}", of(0, "batch_id").as_str().unwrap());
    server.send(server.request(Method::DELETE, &held)).await.expect(200);
    retract(&server, "b", 1).await;
    assert_eq!(server.get("/v1/models/a/versions/1").await["tainted"], false);
    assert_eq!(server.get("/v1/models/c/versions/1").await["tainted"], false);
    // What is tainted stays so in a fork.
    let tainted = fork(&server, "d", "ewc", "b", 1).await.expect(201);
    assert_eq!(tainted["live"], 1);
    assert_eq!(server.get("/v1/models/d/versions/1").await["tainted"], true);
    sound(server).await;
}

#[tokio::test]
async fn a_fork_is_refused_for_what_it_cannot_be() {
    let server = Server::start().await;
    begin(&server, "a", "ewc", &json!({})).await;
    fork(&server, "b", "ewc", "absent", 1).await.expect_problem(404, "model_not_found");
    fork(&server, "b", "ewc", "a", 9).await.expect_problem(404, "version_not_found");
    fork(&server, "a", "ewc", "a", 1).await.expect_problem(409, "model_exists");
    let other = fork(&server, "b", "mas", "a", 1).await.expect_problem(422, "invalid_body");
    assert_eq!(other["errors"][0]["pointer"], "/method");
    let wish = |settings: Value| json!({"model": "b", "method": "ewc", "settings": settings, "from": {"model": "a", "version": 1}});
    for (name, value) in [("hidden", json!(9)), ("split_seed", json!(9)), ("dt_s", json!(0.2)), ("odd", json!(1))] {
        let refused = server.post("/v1/models", &wish(json!({name: value}))).await;
        let refused = refused.expect_problem(422, "invalid_settings");
        assert_eq!(refused["errors"][0]["pointer"], format!("/settings/{name}"));
    }
    assert_eq!(server.get("/v1/models/b").await.status, 404);
    let settings = json!({"epochs": 2, "promotion": "manual", "schedule": {"min_events": 3, "max_wait_s": 60}});
    for _ in 0..2 {
        let made = server.post_with_key("/v1/models", "a key", &wish(settings.clone())).await.expect(201);
        assert_eq!((&made["settings"]["epochs"], &made["settings"]["hidden"]), (&json!(2), &json!(6)));
    }
    sound(server).await;
}

#[tokio::test]
async fn what_is_corrupt_or_was_not_kept_is_not_forked() {
    let server = Server::start().await;
    begin(&server, "a", "ewc", &json!({})).await;
    let flip = |what: &'static str, back: &'static str| {
        let server = &server;
        async move {
            execute(&database(server), what).await;
            let refused = fork(server, "b", "ewc", "a", 2).await.expect_problem(409, "corrupt");
            assert!(refused["detail"].as_str().unwrap().contains("nothing was copied"), "{}", refused.text);
            execute(&database(server), back).await;
        }
    };
    flip(
        "update event set arrays = cast(arrays || x'00' as blob) where event_id = (select max(event_id) from event)",
        "update event set arrays = substr(arrays, 1, length(arrays) - 1) where event_id = (select max(event_id) from event)",
    )
    .await;
    flip(
        "update weights set weights = cast(weights || x'00' as blob)",
        "update weights set weights = substr(weights, 1, length(weights) - 1)",
    )
    .await;
    flip("update version set stage = stage + 7", "update version set stage = stage - 7").await;
    flip(
        "update version_regime set test_events = test_events + 1",
        "update version_regime set test_events = test_events - 1",
    )
    .await;
    flip(
        "update anchor set weights = cast(weights || x'00' as blob)",
        "update anchor set weights = substr(weights, 1, length(weights) - 1)",
    )
    .await;
    flip(
        "update reservoir set event_ids = cast(event_ids || zeroblob(8) as blob)",
        "update reservoir set event_ids = substr(event_ids, 1, length(event_ids) - 8)",
    )
    .await;
    fork(&server, "b", "ewc", "a", 2).await.expect(201);
    execute(
        &database(&server),
        "insert into pruned (model_id, version, pruned_at) select model_id, 1, created_at from model where name = 'a'",
    )
    .await;
    fork(&server, "c", "ewc", "a", 1).await.expect_problem(410, "version_pruned");
    server.stop().await;
}
