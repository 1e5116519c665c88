use serde_json::json;

use crate::support::server::Server;

#[tokio::test]
async fn a_request_sent_again_gets_the_same_answer_and_has_no_further_effect() {
    let server = Server::start().await;
    let wish = json!({"model": "a", "method": "ewc"});
    let first = server.post_with_key("/v1/models", "k1", &wish).await.expect(201);
    let again = server.post_with_key("/v1/models", "k1", &wish).await.expect(201);
    assert_eq!(again.text, first.text);
    for header in ["etag", "location", "content-type"] {
        assert_eq!(again.header(header), first.header(header));
    }
    assert_eq!((first.header("idempotency-replayed"), again.header("idempotency-replayed")), ("", "true"));
    server.post_with_key("/v1/models", "k2", &wish).await.expect_problem(409, "model_exists");
    let server = server.restart().await;
    assert_eq!(server.post_with_key("/v1/models", "k1", &wish).await.expect(201).text, first.text);
    server.stop().await;
}

#[tokio::test]
async fn a_key_belongs_to_one_request() {
    let server = Server::start().await;
    server.post_with_key("/v1/models", "k", &json!({"model": "a", "method": "ewc"})).await.expect(201);
    let other = json!({"model": "b", "method": "ewc"});
    server.post_with_key("/v1/models", "k", &other).await.expect_problem(422, "idempotency_mismatch");
    server.get("/v1/models/b").await.expect(404);
    server.post_with_key("/v1/models", &"x".repeat(300), &other).await.expect_problem(400, "malformed_header");
    server.stop().await;
}

#[tokio::test]
async fn a_refusal_is_not_kept() {
    let server = Server::start().await;
    let wish = json!({"model": "a", "method": "ewc", "settings": {"hidden": 0}});
    server.post_with_key("/v1/models", "k", &wish).await.expect(422);
    server.post_with_key("/v1/models", "k", &json!({"model": "a", "method": "ewc"})).await.expect(201);
    server.stop().await;
}

#[tokio::test]
async fn the_same_key_at_once_is_answered_once() {
    let server = Server::start().await;
    let wish = json!({"model": "a", "method": "ewc"});
    let requests = (0..8).map(|_| server.post_with_key("/v1/models", "k", &wish));
    let statuses: Vec<u16> =
        futures_util::future::join_all(requests).await.iter().map(|answer| answer.status).collect();
    assert!(statuses.contains(&201), "{statuses:?}");
    assert!(statuses.iter().all(|status| [201, 409].contains(status)), "{statuses:?}");
    assert_eq!(server.get("/v1/models").await["models"].as_array().unwrap().len(), 2);
    server.stop().await;
}
