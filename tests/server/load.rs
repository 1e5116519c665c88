use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use futures_util::future::join_all;
use reqwest::Method;
use serde_json::{Value, json};
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;

use crate::support::events::{events, window};
use crate::support::server::Server;

const PREDICT: &str = "/v1/models/default/predict";

async fn two_versions(settings: &str) -> Server {
    let server = Server::start_with(settings).await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    server.learn("default", "slow", &events("f", 12, 6.0)).await;
    server
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn versions_that_change_under_load_drop_no_request_and_mix_none() {
    const CLIENTS: u8 = 16;
    let server = two_versions("").await;
    let window_of = |client: u8| window(5, 8.0 + f64::from(client) / 4.0);
    let mut expected: Vec<[Value; 2]> = Vec::new();
    for client in 0..CLIENTS {
        let mut of_client = Vec::new();
        for version in [1, 2] {
            let body = json!({"windows": [window_of(client)], "version": version});
            of_client.push(server.post(PREDICT, &body).await.expect(200)["predictions"].clone());
        }
        assert_ne!(of_client[0], of_client[1]);
        expected.push(of_client.try_into().unwrap());
    }
    let moved = AtomicBool::new(false);
    let client = async |client: u8| {
        let body = json!({"windows": [window_of(client)]});
        let mut seen = [0; 2];
        while !moved.load(Ordering::Relaxed) {
            let answer = server.post(PREDICT, &body).await.expect(200);
            let version = usize::try_from(answer["version"].as_u64().unwrap()).unwrap();
            assert_eq!(answer["predictions"], expected[usize::from(client)][version - 1], "of version {version}");
            seen[version - 1] += 1;
        }
        seen
    };
    let moves = async {
        for turn in 0..20 {
            let version = 1 + turn % 2;
            let wish = json!({"version": version, "reason": "a test"});
            server.post("/v1/models/default/promote", &wish).await.expect(200);
            // Once the move is answered no request that comes after it is answered by the version before.
            let after = server.post(PREDICT, &json!({"windows": [window_of(0)]})).await.expect(200);
            assert_eq!(after["version"], version);
        }
        server.post("/v1/models/default/rollback", &json!({"version": 1, "reason": "a test"})).await.expect(200);
        let after = server.post(PREDICT, &json!({"windows": [window_of(0)]})).await.expect(200);
        assert_eq!(after["version"], 1);
        moved.store(true, Ordering::Relaxed);
    };
    let (seen, ()) = tokio::join!(join_all((0..CLIENTS).map(client)), moves);
    let seen = seen.iter().fold([0; 2], |sum, one| [sum[0] + one[0], sum[1] + one[1]]);
    assert!(seen[0] > 0 && seen[1] > 0, "both versions served: {seen:?}");
    server.stop().await;
}

#[tokio::test]
async fn a_model_serves_from_its_first_version_on() {
    let server = Server::start().await;
    let body = json!({"windows": [window(5, 10.0)]});
    server.post("/v1/models/late/predict", &body).await.expect_problem(404, "model_not_found");
    server.post("/v1/models", &json!({"model": "late", "method": "naive"})).await.expect(201);
    server.post("/v1/models/late/predict", &body).await.expect_problem(409, "no_live_version");
    server.learn("late", "fast", &events("e", 12, 16.0)).await;
    assert_eq!(server.post("/v1/models/late/predict", &body).await.expect(200)["version"], 1);
    server.stop().await;
}

#[tokio::test]
async fn more_windows_than_may_wait_are_told_to_come_back() {
    let server = two_versions("[predict]\ninline_windows = 8\nwaiting_windows = 4").await;
    let windows = |count| json!({"windows": vec![window(5, 10.0); count]});
    let refused = server.post(PREDICT, &windows(5)).await.expect_problem(503, "busy");
    assert_eq!(refused.header("retry-after"), "1");
    server.post(PREDICT, &windows(4)).await.expect(200);
    server.post(PREDICT, &windows(9)).await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn long_bodies_that_would_take_more_memory_together_than_there_is_for_them_are_told_to_wait() {
    const PATIENCE: Duration = Duration::from_mins(1);
    let server = Server::start_with("[server]\njson_bodies_bytes = 300_000").await;
    let long = format!("{}{{}}", " ".repeat(200_000));
    let asked = async || {
        let request = server.request(Method::POST, "/v1/models").header("content-type", "application/json");
        server.send(request.body(long.clone())).await
    };
    let asked_until = async |status: u16| {
        let since = Instant::now();
        while asked().await.status != status {
            assert!(since.elapsed() < PATIENCE, "never {status}");
        }
    };
    asked().await.expect(422);
    let mut other = TcpStream::connect(server.url.trim_start_matches("http://")).await.unwrap();
    let head =
        "POST /v1/models HTTP/1.1\r\nhost: x\r\ncontent-type: application/json\r\ncontent-length: 200003\r\n\r\n";
    other.write_all(format!("{head}{long}").as_bytes()).await.unwrap();
    // Its last byte does not come, so what came of it stays in memory.
    asked_until(503).await;
    let refused = asked().await.expect_problem(503, "busy");
    assert_eq!(refused.header("retry-after"), "1");
    server.post("/v1/models", &json!({})).await.expect(422);
    drop(other);
    asked_until(422).await;
    server.stop().await;
}
