use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, query};

use crate::support::events::{events, window};
use crate::support::server::Server;

const PREDICT: &str = "/v1/models/default/predict";

/// A server that has learned two versions, before and after somebody damaged its database.
async fn damaged(statement: &'static str) -> (Server, Value) {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    let of_the_first = predict(&server).await;
    server.learn("default", "slow", &events("f", 12, 6.0)).await;
    let database = server.directory.path().join("headway.db");
    let mut connection = SqliteConnectOptions::new().filename(database).connect().await.unwrap();
    query(statement).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
    (server.restart().await, of_the_first)
}

async fn predict(server: &Server) -> Value {
    server.post(PREDICT, &json!({"windows": [window(5, 9.0)]})).await.expect(200).body
}

#[tokio::test]
async fn a_corrupt_live_version_is_reported_and_its_newest_good_ancestor_serves() {
    let (server, of_the_first) =
        damaged("update weights set weights = zeroblob(length(weights)) where version = 2").await;
    assert_eq!(predict(&server).await, of_the_first);
    let ready = server.get("/readyz").await.expect(200);
    assert_eq!(ready["degraded"], json!([{"model": "default", "live": 2, "serving": 1}]));
    let metrics = server.get("/metrics").await.expect(200).text;
    for line in [
        "headway_corrupt_versions{model=\"default\"} 1",
        "headway_live_version{model=\"default\"} 2",
        "headway_serving_version{model=\"default\"} 1",
    ] {
        assert!(metrics.contains(line), "{line} is not in {metrics}");
    }
    let named = json!({"windows": [window(5, 9.0)], "version": 2});
    server.post(PREDICT, &named).await.expect_problem(409, "corrupt");
    let version = server.get("/v1/models/default/versions/2").await.expect(200);
    assert!(version["corrupt"].as_str().unwrap().contains("weights"), "{}", version.text);
    assert_eq!(server.get("/v1/models/default/versions/1").await.expect(200)["corrupt"], json!(null));
    let wish = json!({"version": 2, "reason": "a test"});
    server.post("/v1/models/default/promote", &wish).await.expect_problem(409, "corrupt");
    server.upload("default", "?regime=jam", &events("g", 12, 2.0)).await.expect(201);
    let task = server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    let ended = server.end_of("default", task["task_id"].as_str().unwrap()).await;
    assert_eq!(ended["error"]["code"], "corrupt_version", "{}", ended.text);
    server.post("/v1/models/default/rollback", &json!({"reason": "version 2 is corrupt"})).await.expect(200);
    assert_eq!(server.get("/readyz").await.expect(200).body, json!({"status": "ready"}));
    let task = server.post("/v1/models/default/tasks", &json!({"batches": ["b3"]})).await.expect(202);
    let ended = server.end_of("default", task["task_id"].as_str().unwrap()).await;
    assert_eq!((&ended["state"], &ended["version"]), (&json!("succeeded"), &json!(3)));
    server.stop().await;
}

#[tokio::test]
async fn a_version_of_which_no_ancestor_is_good_is_not_served() {
    let (server, _) = damaged("update version set scaling = replace(scaling, '1', '2')").await;
    let body = json!({"windows": [window(5, 9.0)]});
    server.post(PREDICT, &body).await.expect_problem(409, "corrupt");
    server.get("/readyz").await.expect_problem(503, "not_ready");
    let listed = server.get("/v1/models/default/versions").await.expect(200);
    assert!(listed["versions"][0]["corrupt"].is_string(), "a row that can be read is listed: {}", listed.text);
    server.stop().await;
}

#[tokio::test]
async fn a_version_that_turns_corrupt_while_the_server_runs_is_told_when_it_is_read() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    let before = predict(&server).await;
    let database = server.directory.path().join("headway.db");
    let mut connection = SqliteConnectOptions::new().filename(database).connect().await.unwrap();
    query("update weights set weights = zeroblob(length(weights))").execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
    assert!(server.get("/v1/models/default/versions/1").await.expect(200)["corrupt"].is_string());
    assert_eq!(predict(&server).await, before, "what is loaded is what was written");
    server.stop().await;
}
