//! Everything that a server does to its database, once.

use reqwest::Method;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::support::events::{event, events, window};
use crate::support::server::Server;

/// Leads a server through it and stops it; its database is left.
pub(crate) async fn lead() -> TempDir {
    let backups = tempfile::tempdir().unwrap();
    let folder = backups.path().display();
    let settings = format!("[training]\ntrigger_interval_s = 0.05\n[backup]\nfolder = \"{folder}\"");
    let server = Server::start_with(&settings).await;
    upload(&server).await;
    learn(&server).await;
    unlearn(&server).await;
    copy(&server).await;
    forget(&server).await;
    move_about(&server).await;
    stop_and_cancel(&server).await;
    let mut server = server.restart().await;
    list(&server).await;
    manage_keys(&mut server).await;
    server.stop().await
}

/// Good, bad, known and retracted events; a schedule that waits for more of them.
async fn upload(server: &Server) {
    let path = "/v1/models/uploads/batches";
    let settings = json!({"schedule": {"min_events": 9, "max_wait_s": 3600}});
    let body = json!({"model": "uploads", "method": "naive", "settings": settings});
    for _ in 0..2 {
        server.post_with_key("/v1/models", "a key", &body).await.expect(201);
    }
    let bad =
        json!({"event_id": "bad", "dt_s": 0.1, "spacing_m": [1], "follower_speed_mps": [], "leader_speed_mps": []});
    let mut mixed = events("e", 3, 12.0);
    mixed.push(bad);
    for key in ["an upload", "the same again"] {
        server.post_with_key(&format!("{path}?regime=fast"), key, &json!({"events": mixed})).await.expect(201);
    }
    server.get(&format!("{path}/b1/rejections")).await.expect(200);
    server.get(&format!("{path}/b1/events")).await.expect(200);
    for batch in ["b1", "b2"] {
        server.send(server.request(Method::DELETE, &format!("{path}/{batch}?erase=true"))).await.expect(200);
    }
    while server.get(&format!("{path}/b2")).await["erased_at"].is_null() {}
    server.post("/v1/models/uploads/tasks", &json!({"batches": ["b1"]})).await.expect(409);
    server.upload("uploads", "?regime=fast", &mixed).await.expect(201);
    server.upload("uploads", "?regime=slow", &events("f", 9, 6.0)).await.expect(201);
    let failing: Vec<_> = std::iter::repeat_n(mixed.last().unwrap().clone(), 60).chain(events("h", 2, 9.0)).collect();
    server.upload("uploads", "?source=site", &failing).await.expect(201);
    server.get("/v1/models/uploads/sources").await.expect(200);
    server.post("/v1/models/uploads/sources/site/release", &json!({})).await.expect(200);
}

/// Tasks of every kind of method, from whatever selects events.
async fn learn(server: &Server) {
    for method in ["ewc", "joint", "replay", "mas"] {
        let settings = if method == "mas" { json!({"strength": "auto"}) } else { json!({}) };
        server.post("/v1/models", &json!({"model": method, "method": method, "settings": settings})).await.expect(201);
        for (regime, speed) in [("fast", 12.0), ("slow", 6.0)] {
            let mut batch = events(regime, 12, speed);
            batch.push(event(&format!("{regime} to validate"), speed, "validation"));
            server.learn(method, regime, &batch).await;
        }
    }
    server.upload("ewc", "?regime=tests", &[event("test", 12.0, "test")]).await.expect(201);
    let named = json!({"batches": ["pending"], "where": {"mean_speed_mps": [1.0, 60.0]}});
    assert_eq!(server.post("/v1/models/ewc/tasks", &named).await.status / 100, 4);
    let pending = json!({"batches": "pending", "where": {"mean_speed_mps": [1.0, 60.0]}});
    let task = server.post("/v1/models/ewc/tasks", &pending).await.expect(202);
    assert_eq!(server.end_of("ewc", task["task_id"].as_str().unwrap()).await["state"], "failed");
    let batches = server.get("/v1/models/ewc/batches").await;
    let first = batches["batches"][0]["batch_id"].as_str().unwrap();
    let again = server.post("/v1/models/ewc/tasks", &json!({"batches": [first]})).await.expect(202);
    server.end_of("ewc", again["task_id"].as_str().unwrap()).await;
}

/// A batch that a version learned and a task waits for leaves both; so does the next one, while the first is replayed.
async fn unlearn(server: &Server) {
    let path = |rest: &str| format!("/v1/models/mas/{rest}");
    server.post(&path("pause"), &json!({})).await.expect(200);
    let batches = server.get(&path("batches")).await["batches"].clone();
    let ids: Vec<_> = batches.as_array().unwrap().iter().map(|batch| batch["batch_id"].as_str().unwrap()).collect();
    server.post(&path("tasks"), &json!({"batches": ids, "regime": "both"})).await.expect(202);
    let mut replays = Vec::new();
    for id in ids {
        let retract = || server.send(server.request(Method::DELETE, &path(&format!("batches/{id}"))));
        replays.push(retract().await.expect(202)["task_id"].as_str().unwrap().to_owned());
        retract().await;
    }
    server.post(&path("resume"), &json!({})).await.expect(200);
    for replay in replays {
        server.end_of("mas", &replay).await;
    }
}

/// A fork, an archive, and a model out of it.
async fn copy(server: &Server) {
    let from = json!({"model": "fork", "method": "mas", "from": {"model": "mas", "version": 1}});
    server.post("/v1/models", &from).await.expect(201);
    for of in ["mas", "uploads"] {
        let archive = server.request(Method::GET, &format!("/v1/models/{of}/archive")).send().await.unwrap();
        let archive = archive.bytes().await.unwrap();
        let request = server.request(Method::POST, &format!("/v1/models/{of}-moved/archive"));
        server.send(request.header("content-type", "application/vnd.sqlite3").body(archive)).await.expect(201);
    }
}

/// A model that keeps little, and what that refuses.
async fn forget(server: &Server) {
    server.post("/v1/models", &json!({"model": "short", "method": "ewc"})).await.expect(201);
    let change = json!({"retention": {"versions": 1, "events_s": 0}});
    server.send(server.request(Method::PATCH, "/v1/models/short").json(&change)).await.expect(200);
    for (regime, speed) in [("fast", 12.0), ("middle", 9.0), ("slow", 6.0)] {
        server.learn("short", &format!("short-{regime}"), &events(&format!("short {regime}"), 12, speed)).await;
    }
    while server.get("/v1/models/short/versions/1").await["pruned"] == false {}
    let batches = server.get("/v1/models/short/batches").await;
    let path = |at: usize| format!("/v1/models/short/batches/{}", batches["batches"][at]["batch_id"].as_str().unwrap());
    while server.get(&path(1)).await["pruned_events"] == 0 {}
    server.send(server.request(Method::DELETE, &path(0))).await.expect(409);
}

/// What people ask of versions.
async fn move_about(server: &Server) {
    let evaluated = "/v1/models/ewc/evaluate?versions=1&references=idm&regime=fast";
    server.post(evaluated, &json!({"events": events("g", 4, 12.0)})).await.expect(200);
    server.post("/v1/models/ewc/predict", &json!({"version": 1, "windows": [window(5, 11.0)]})).await.expect(200);
    bring(server).await;
    for note in [json!("a note"), Value::Null] {
        let request = server.request(Method::PATCH, "/v1/models/ewc/versions/1").json(&json!({"note": note}));
        server.send(request).await.expect(200);
    }
    server.post("/v1/models/ewc/promote", &json!({"version": 1, "reason": "tried"})).await.expect(200);
    server.post("/v1/models/ewc/promote", &json!({"version": 2, "reason": "tried"})).await.expect(200);
    server.post("/v1/models/ewc/rollback", &json!({"reason": "tried"})).await.expect(200);
}

/// A version that goes out as a file and comes in as another model's.
async fn bring(server: &Server) {
    let file = server.request(Method::GET, "/v1/models/ewc/versions/2/artifact?format=safetensors");
    let file = file.send().await.unwrap().bytes().await.unwrap();
    server.post("/v1/models", &json!({"model": "brought", "method": "ewc"})).await.expect(201);
    let import = server.request(Method::POST, "/v1/models/brought/versions").body(file);
    server.send(import.header("content-type", "application/octet-stream")).await.expect(201);
    server.learn("brought", "jam", &events("jam", 12, 3.0)).await;
}

/// A task that is held, goes on from its checkpoint and is cancelled; and one that a stop of the server interrupts.
async fn stop_and_cancel(server: &Server) {
    server.upload("ewc", "?regime=long", &events("long", 200, 10.0)).await.expect(201);
    let wish = json!({"batches": "pending", "settings": {"epochs": 1000}});
    let task = server.post("/v1/models/ewc/tasks", &wish).await.expect(202);
    let path = format!("/v1/models/ewc/tasks/{}", task["task_id"].as_str().unwrap());
    let until = async |state: &str, progress: f64| {
        loop {
            let task = server.get(&path).await.expect(200);
            if task["state"] == state && task["progress"].as_f64().unwrap() >= progress {
                return;
            }
        }
    };
    until("running", 1e-6).await;
    server.post("/v1/models/ewc/pause", &json!({})).await.expect(200);
    until("queued", 0.0).await;
    server.post("/v1/models/ewc/resume", &json!({})).await.expect(200);
    until("running", 1e-6).await;
    server.post(&format!("{path}/cancel"), &json!({})).await;
    server.end_of("ewc", task["task_id"].as_str().unwrap()).await;
    server.upload("ewc", "?regime=longer", &events("longer", 200, 10.0)).await.expect(201);
    let left = server.post("/v1/models/ewc/tasks", &wish).await.expect(202);
    assert_eq!(left["state"], "queued");
}

/// Everything that lists or counts.
async fn list(server: &Server) {
    for path in
        ["", "/ewc", "/ewc/batches", "/ewc/tasks", "/ewc/versions", "/ewc/versions/1/evaluation", "/ewc/history"]
    {
        server.get(&format!("/v1/models{path}")).await.expect(200);
    }
    server.get("/v2/models/ewc").await.expect(200);
    server.get("/metrics").await.expect(200);
    server.get("/readyz").await.expect(200);
}

/// Keys, made, read and revoked; and a list for one that is limited.
async fn manage_keys(server: &mut Server) {
    server.close_gate().await;
    let key = server.make_key(&json!({"scopes": ["ingest"], "models": ["ewc"]})).await;
    server.get("/v1/keys").await.expect(200);
    let path = format!("/v1/keys/{}", &key[3..19]);
    server.get(&path).await.expect(200);
    server.get("/v1/audit").await.expect(200);
    server.post_with_key("/v1/backup", "a backup", &json!({})).await.expect(201);
    server.get("/v1/audit?model=ewc").await.expect(200);
    server.send(server.request(Method::DELETE, &path)).await.expect(200);
}
