use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use headway::access::Issued;
use reqwest::Method;
use serde_json::{Value, json};

use crate::support::events::{event, events, window};
use crate::support::server::Server;

/// Every entry, as `action resource actor`.
async fn told(server: &Server, query: &str) -> Vec<String> {
    let log = server.get(&format!("/v1/audit?page_size=1000{query}")).await.expect(200);
    let line = |entry: &Value| ["action", "resource", "actor"].map(|member| entry[member].as_str().unwrap()).join(" ");
    log["audit"].as_array().unwrap().iter().map(line).collect()
}

#[tokio::test]
async fn every_change_of_state_is_in_the_log_with_who_made_it() {
    let mut server = Server::start().await;
    server.close_gate().await;
    let admin = server.key.clone().unwrap();
    let trainer = server.make_key(&json!({"scopes": ["train", "ingest"], "models": ["default"]})).await;
    server.post("/v1/models", &json!({"model": "b", "method": "mas"})).await.expect(201);
    server.key = Some(trainer.clone());
    server.learn("default", "fast", &events("e", 12, 10.0)).await;
    server.learn("default", "slow", &events("f", 12, 5.0)).await;
    for note in [json!("one"), json!("two"), Value::Null] {
        let request = server.request(Method::PATCH, "/v1/models/default/versions/1").json(&json!({"note": note}));
        server.send(request).await.expect(200);
    }
    server.post("/v1/models/default/promote", &json!({"version": 1, "reason": "r"})).await.expect(200);
    server.post("/v1/models/default/rollback", &json!({"version": 1, "reason": "r"})).await.expect(200);
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "?regime=late", &[event("g", 7.0, "train")]).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    server.post("/v1/models/default/tasks/t3/cancel", &json!({})).await.expect(200);
    server.post("/v1/models/default/resume", &json!({})).await.expect(200);
    server.upload("default", "?regime=late", &[event("h", 8.0, "train")]).await.expect(201);
    server.send(server.request(Method::DELETE, "/v1/models/default/batches/b4")).await.expect(200);
    // What is refused changes nothing, and neither does what is only read.
    server.post("/v1/models/default/promote", &json!({"version": 9, "reason": "r"})).await.expect(404);
    server.get("/v1/audit").await.expect_problem(403, "insufficient_scope");
    server.key = Some(admin.clone());
    server.send(server.request(Method::DELETE, &format!("/v1/keys/{}", &trainer[3..19]))).await.expect(200);
    let (admin, trainer) = (&admin[3..19], &trainer[3..19]);
    let learned = |n: u32| {
        [
            format!("batch.upload b{n} {trainer}"),
            format!("task.create t{n} {trainer}"),
            format!("version.create {n} server"),
            format!("version.promote {n} policy"),
        ]
    };
    let own = [
        "version.note 1",
        "version.note 1",
        "version.note 1",
        "version.promote 1",
        "version.rollback 1",
        "model.pause default",
        "batch.upload b3",
        "task.create t3",
        "task.cancel t3",
        "model.resume default",
        "batch.upload b4",
        "batch.retract b4",
    ];
    let of_model: Vec<String> =
        [vec!["model.create default server".to_owned()], learned(1).to_vec(), learned(2).to_vec()]
            .into_iter()
            .flatten()
            .chain(own.map(|entry| format!("{entry} {trainer}")))
            .collect();
    assert_eq!(told(&server, "&model=default").await, of_model);
    let everything = told(&server, "").await;
    let others = [
        format!("key.create {admin} local"),
        format!("key.create {trainer} {admin}"),
        format!("model.create b {admin}"),
        format!("key.revoke {trainer} {admin}"),
    ];
    assert_eq!(everything.len(), of_model.len() + others.len());
    assert!(others.iter().all(|entry| everything.contains(entry)), "{everything:#?}");
    server.get("/v1/audit?model=nobody").await.expect_problem(404, "model_not_found");
    server.stop().await;
}

#[tokio::test]
async fn an_entry_names_the_request_and_the_log_pages() {
    let server = Server::start().await;
    let request = server.request(Method::POST, "/v1/models/default/pause").header("x-request-id", "mine-7");
    server.send(request).await.expect(200);
    let first = server.get("/v1/audit?page_size=1").await.expect(200);
    assert_eq!(first["audit"][0]["action"], "model.create");
    let token = first["next_page_token"].as_str().unwrap();
    let second = server.get(&format!("/v1/audit?page_size=1&page_token={token}")).await.expect(200);
    assert_eq!(second["audit"][0]["request_id"], "mine-7");
    assert_eq!((&second["audit"][0]["actor"], &second["next_page_token"]), (&json!("local"), &Value::Null));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn no_secret_is_in_any_log_or_in_the_database() {
    let directory = tempfile::tempdir().unwrap();
    let log = std::fs::File::create(directory.path().join("log")).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_headway"))
        .args(["--listen", "127.0.0.1:0", "--set", "log.filter=trace", "--database"])
        .arg(directory.path().join("headway.db"))
        .stdout(Stdio::piped())
        .stderr(log)
        .spawn()
        .unwrap();
    let mut first = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
    let url = first.trim().strip_prefix("listening on ").unwrap().to_owned();
    let client = reqwest::Client::new();
    let ask = |method: Method, path: &str, key: Option<&str>, body: Value| {
        let request = client.request(method, format!("{url}{path}")).json(&body).header("idempotency-key", "k");
        let request = if let Some(key) = key { request.bearer_auth(key) } else { request };
        async { request.send().await.unwrap().text().await.unwrap() }
    };
    let make = |key: Option<String>, scopes: Value| {
        let made = ask(Method::POST, "/v1/keys", key.as_deref(), json!({"scopes": scopes}));
        async { serde_json::from_str::<Value>(&made.await).unwrap()["key"].as_str().unwrap().to_owned() }
    };
    let admin = make(None, json!(["admin"])).await;
    let other = make(Some(admin.clone()), json!(["predict"])).await;
    let foreign = Issued::draw().unwrap().reveal().to_owned();
    let predict = json!({"windows": [window(10, 9.0)]});
    for key in [&admin, &other, &foreign] {
        ask(Method::POST, "/v1/models/default/predict", Some(key), predict.clone()).await;
        ask(Method::POST, "/v1/models", Some(key), json!({"model": "a", "method": "ewc"})).await;
        ask(Method::GET, "/v1/keys", Some(key), Value::Null).await;
    }
    ask(Method::DELETE, &format!("/v1/keys/{}", &other[3..19]), Some(&admin), Value::Null).await;
    ask(Method::GET, "/v1/models", Some(&other), Value::Null).await;
    let read = |path: &std::path::Path| std::fs::read(path).unwrap();
    let files = || std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().path());
    let before: Vec<_> = files().map(|path| (path.clone(), read(&path))).collect();
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    assert!(child.wait().unwrap().success());
    let log = String::from_utf8(read(&directory.path().join("log"))).unwrap();
    assert!(log.contains("DEBUG") && log.contains(&admin[3..19]) && log.contains("/predict"), "the log tells much");
    for (path, bytes) in before.into_iter().chain(files().map(|path| (path.clone(), read(&path)))) {
        for key in [&admin, &other, &foreign] {
            let secret = &key.as_bytes()[20..];
            assert!(!bytes.windows(secret.len()).any(|window| window == secret), "{} has it", path.display());
        }
    }
}
