use reqwest::Method;
use serde_json::json;

use crate::support::events::events;
use crate::support::server::Server;

const PATH: &str = "/v1/models/default/batches";

#[tokio::test]
async fn a_batch_is_read_with_its_events_by_state() {
    let server = Server::start().await;
    let uploaded = server.upload("default", "?source=site&regime=fast", &events("e", 4, 10.0)).await.expect(201);
    let batch = server.get(&format!("{PATH}/{}", uploaded["batch_id"].as_str().unwrap())).await.expect(200);
    assert_eq!((&batch["source"], &batch["regime"], &batch["accepted"]), (&json!("site"), &json!("fast"), &json!(4)));
    assert_eq!(batch["events"], json!({"pending": 4, "learned": 0, "set_aside": 0, "held": 0, "retracted": 0}));
    assert_eq!(batch["summary"]["splits"], json!({"train": 3, "test": 1}));
    server.post("/v1/models", &json!({"model": "other", "method": "ewc"})).await.expect(201);
    server.get("/v1/models/other/batches/b1").await.expect_problem(404, "batch_not_found");
    server.get("/v1/models/other/batches/b1/rejections").await.expect_problem(404, "batch_not_found");
    server.stop().await;
}

#[tokio::test]
async fn a_batch_is_retracted_at_once_and_may_come_again() {
    let server = Server::start().await;
    let events = events("e", 4, 10.0);
    let uploaded = server.upload("default", "", &events).await.expect(201);
    let path = format!("{PATH}/{}", uploaded["batch_id"].as_str().unwrap());
    for _ in 0..2 {
        let retracted = server.send(server.request(Method::DELETE, &path)).await.expect(200);
        assert_eq!((&retracted["events"]["retracted"], &retracted["events"]["pending"]), (&json!(4), &json!(0)));
        assert!(retracted["retracted_at"].is_string());
    }
    server
        .post("/v1/models/default/tasks", &json!({"batches": "pending"}))
        .await
        .expect_problem(409, "nothing_pending");
    let named = json!({"batches": [uploaded["batch_id"]]});
    server.post("/v1/models/default/tasks", &named).await.expect_problem(409, "batch_retracted");
    assert_eq!(server.upload("default", "", &events).await.expect(201)["accepted"], 4);
    server.send(server.request(Method::DELETE, &format!("{PATH}/b99"))).await.expect_problem(404, "batch_not_found");
    server.stop().await;
}

#[tokio::test]
async fn batches_are_listed_in_order_of_arrival() {
    let server = Server::start().await;
    for kind in ["e", "f", "g"] {
        server.upload("default", "", &events(kind, 1, 10.0)).await.expect(201);
    }
    let first = server.get(&format!("{PATH}?page_size=2")).await.expect(200);
    let ids =
        |page: &serde_json::Value| page.as_array().unwrap().iter().map(|b| b["batch_id"].clone()).collect::<Vec<_>>();
    assert_eq!(ids(&first["batches"]), ["b1", "b2"]);
    let token = first["next_page_token"].as_str().unwrap();
    let rest = server.get(&format!("{PATH}?page_size=2&page_token={token}")).await.expect(200);
    assert_eq!(ids(&rest["batches"]), ["b3"]);
    server.stop().await;
}
