use serde_json::{Value, json};

use crate::support::events::{events, window};
use crate::support::server::Server;

/// JSON has one kind of number, and the contract's integers are whole ones, however they are written.
#[tokio::test]
async fn whole_numbers_are_integers_however_they_are_written() {
    let server = Server::start().await;
    let text = r#"{"model": "a", "method": "ewc", "settings": {"hidden": 7.0, "epochs": 2e0, "retention": {"versions": 3.0}}}"#;
    let model = server.post("/v1/models", &serde_json::from_str(text).unwrap()).await.expect(201);
    assert_eq!((&model["settings"]["hidden"], &model["settings"]["retention"]["versions"]), (&json!(7), &json!(3)));
    server.learn("a", "fast", &events("e", 12, 15.0)).await;
    let (promote, predict) = ("/v1/models/a/promote", "/v1/models/a/predict");
    server.post(promote, &json!({"version": 1.0, "reason": "because"})).await.expect(200);
    server.post("/v1/models/a/rollback", &json!({"version": 1.0, "reason": "because"})).await.expect(200);
    let asked = |version: Value| json!({"windows": [window(5, 15.0)], "version": version});
    server.post(predict, &asked(json!(1.0))).await.expect(200);
    server.post(predict, &asked(json!(1.5))).await.expect_problem(422, "invalid_body");
    let halves = json!({"model": "b", "method": "ewc", "settings": {"hidden": 7.5}});
    server.post("/v1/models", &halves).await.expect_problem(422, "invalid_settings");
    server.stop().await;
}

/// As the contract's `maxLength` does.
#[tokio::test]
async fn lengths_are_counted_in_characters() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 15.0)).await;
    let letters = |count| "ü".repeat(count);
    let promotion = |count| json!({"version": 1, "reason": letters(count)});
    server.post("/v1/models/default/promote", &promotion(1024)).await.expect(200);
    server.post("/v1/models/default/promote", &promotion(1025)).await.expect_problem(422, "invalid_body");
    let annotate = async |count| {
        let request = server.request(reqwest::Method::PATCH, "/v1/models/default/versions/1");
        server.send(request.json(&json!({"note": letters(count)}))).await
    };
    annotate(4096).await.expect(200);
    annotate(4097).await.expect_problem(422, "invalid_body");
    let source =
        async |count| server.upload("default", &format!("?source={}", letters(count)), &events("f", 1, 15.0)).await;
    source(512).await.expect(201);
    source(513).await.expect_problem(422, "invalid_query");
    let key = |count| json!({"scopes": ["admin"], "name": letters(count)});
    server.post("/v1/keys", &key(129)).await.expect_problem(422, "invalid_body");
    server.post("/v1/keys", &key(128)).await.expect(201);
    server.stop().await;
}

/// Nothing there is to be hidden.
#[tokio::test]
async fn an_open_path_tells_its_methods_to_who_has_no_key() {
    let mut server = Server::start().await;
    server.close_gate().await;
    server.key = None;
    for path in ["/healthz", "/readyz"] {
        let answer = server.send(server.request(reqwest::Method::PUT, path)).await;
        assert_eq!(answer.expect_problem(405, "method_not_allowed").header("allow"), "GET,HEAD");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_tasks_settings_say_everything_once() {
    let server = Server::start().await;
    server.upload("default", "", &events("e", 12, 15.0)).await.expect(201);
    let body = r#"{"batches": "pending", "settings": {"epochs": 1, "epochs": 2}}"#;
    let request = server.request(reqwest::Method::POST, "/v1/models/default/tasks");
    let answer = server.send(request.header("content-type", "application/json").body(body)).await;
    assert!(answer.expect_problem(422, "invalid_body")["detail"].as_str().unwrap().contains("epochs"));
    server.stop().await;
}
