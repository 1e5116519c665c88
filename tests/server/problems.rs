use reqwest::Method;
use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, query};

use crate::support::server::Server;

#[tokio::test]
async fn what_is_not_there_is_a_problem() {
    let server = Server::start().await;
    server.get("/v3").await.expect_problem(404, "not_found");
    server.get("/v1/models/nobody").await.expect_problem(404, "model_not_found");
    server.get("/v1/models/..%2Fetc").await.expect_problem(404, "model_not_found");
    server.get("/v1/models/%ff").await.expect(404);
    server.get("/v1/models/default/versions/9").await.expect_problem(404, "version_not_found");
    server.get("/v1/models/default/versions/x").await.expect_problem(404, "version_not_found");
    server.get("/v1/models/default/versions/9/evaluation").await.expect_problem(404, "version_not_found");
    for id in ["t1", "b1", "1", "t01", "t99999999999999999999"] {
        server.get(&format!("/v1/models/default/tasks/{id}")).await.expect_problem(404, "task_not_found");
        let cancel = format!("/v1/models/default/tasks/{id}/cancel");
        server.post(&cancel, &json!({})).await.expect_problem(404, "task_not_found");
        server.get(&format!("/v1/models/default/tasks/{id}/progress")).await.expect_problem(404, "task_not_found");
    }
    server.stop().await;
}

#[tokio::test]
async fn bodies_are_refused_for_what_is_wrong_with_them() {
    let server = Server::start().await;
    let post = |kind: &'static str, body: &'static str| {
        server.send(server.request(Method::POST, "/v1/models").header("content-type", kind).body(body))
    };
    post("application/json", r#"{"model": "a", "#).await.expect_problem(400, "malformed_json");
    post("application/json", "").await.expect_problem(400, "malformed_json");
    post("text/plain", "{}").await.expect_problem(415, "unsupported_media_type");
    let unknown = post("application/json", r#"{"model": "a", "method": "ewc", "colour": 1}"#).await;
    assert!(unknown.expect_problem(422, "invalid_body")["detail"].as_str().unwrap().contains("colour"));
    let wrong = post("application/json; charset=utf-8", r#"{"model": "a", "method": "magic"}"#).await;
    assert_eq!(wrong.expect_problem(422, "invalid_body")["errors"][0]["pointer"], "/method");
    let name = post("application/json", r#"{"model": "a b", "method": "ewc"}"#).await;
    assert_eq!(name.expect_problem(422, "invalid_body")["errors"][0]["pointer"], "/model");
    let array = post("application/json", r#"["a", "ewc"]"#).await.expect_problem(422, "invalid_body");
    assert_eq!(array["errors"][0]["pointer"], "");
    let nested = post("application/json", r#"{"model": "a", "method": "ewc", "from": ["default", 1]}"#).await;
    assert_eq!(nested.expect_problem(422, "invalid_body")["errors"][0]["pointer"], "/from");
    let bands = r#"{"model": "a", "method": "ewc", "settings": {"regimes": ["mean_speed_mps", [9.0]]}}"#;
    let nested = post("application/json", bands).await.expect_problem(422, "invalid_settings");
    assert_eq!(nested["errors"][0]["pointer"], "/settings/regimes");
    let bare = server.send(server.request(Method::POST, "/v1/models").body("{}")).await;
    bare.expect_problem(415, "unsupported_media_type");
    server.stop().await;
}

#[tokio::test]
async fn a_change_that_cannot_wait_any_longer_is_told_to_come_again() {
    let server = Server::start_with("[database]\nbusy_timeout_s = 0.05").await;
    let path = server.directory.path().join("headway.db");
    let mut other = SqliteConnectOptions::new().filename(path).connect().await.unwrap();
    query("begin immediate").execute(&mut other).await.unwrap();
    let wish = json!({"model": "a", "method": "ewc"});
    let refused = server.post("/v1/models", &wish).await.expect_problem(503, "database_busy");
    assert_eq!(refused.header("retry-after"), "1");
    query("rollback").execute(&mut other).await.unwrap();
    server.post("/v1/models", &wish).await.expect(201);
    server.stop().await;
}

#[tokio::test]
async fn a_body_beyond_the_limit_is_refused() {
    let server = Server::start_with("[server]\njson_body_bytes = 100").await;
    let wish = json!({"model": "a".repeat(64), "method": "ewc", "settings": {"hidden": 8, "epochs": 1}});
    server.post("/v1/models", &wish).await.expect_problem(413, "body_too_large");
    let chunked =
        reqwest::Body::wrap_stream(futures_util::stream::iter(vec![Ok::<_, std::io::Error>(wish.to_string())]));
    let request = server.request(Method::POST, "/v1/models").header("content-type", "application/json").body(chunked);
    server.send(request).await.expect_problem(413, "body_too_large");
    server.stop().await;
}

#[tokio::test]
async fn a_method_or_a_type_nobody_serves_is_a_problem() {
    let server = Server::start().await;
    server.send(server.request(Method::DELETE, "/v1/models/default")).await.expect_problem(405, "method_not_allowed");
    let html = server.request(Method::GET, "/v1/models").header("accept", "text/html");
    server.send(html).await.expect_problem(406, "not_acceptable");
    server.stop().await;
}

#[tokio::test]
async fn a_request_keeps_the_id_it_brought() {
    let server = Server::start().await;
    let request = |id: &str| server.request(Method::GET, "/v1/models/nobody").header("x-request-id", id);
    let mine = server.send(request("trace-1")).await;
    assert_eq!((mine.header("x-request-id"), &mine["request_id"]), ("trace-1", &json!("trace-1")));
    assert_eq!(mine["instance"], "/v1/models/nobody");
    assert_ne!(server.send(request("not one id")).await.header("x-request-id"), "not one id");
    server.stop().await;
}

#[tokio::test]
async fn the_query_is_refused_when_it_is_not_understood() {
    let server = Server::start().await;
    for query in ["page_size=0", "page_size=x", "page_token=zz", "page=1"] {
        let answer = server.get(&format!("/v1/models?{query}")).await.expect_problem(422, "invalid_query");
        assert_eq!(answer["errors"][0]["parameter"], query.split_once('=').unwrap().0);
    }
    server.stop().await;
}

#[tokio::test]
async fn health_and_metrics_tell_how_it_is() {
    let server = Server::start().await;
    assert_eq!(server.get("/healthz").await.expect(200)["status"], "ok");
    assert_eq!(server.get("/readyz").await.expect(200)["status"], "ready");
    let metrics = server.get("/metrics").await.expect(200).text;
    assert!(
        metrics.contains(r#"headway_http_requests_total{route="/readyz",method="GET",status="200"} 1"#),
        "{metrics}"
    );
    assert!(metrics.contains(r#"headway_live_version{model="default"} 0"#), "{metrics}");
    server.stop().await;
}
