use std::time::Duration;

use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use crate::support::events::window;
use crate::support::server::Server;

/// Far longer than any patience below; what is waited for here happens, or the test fails.
const LONG: Duration = Duration::from_mins(1);

const HURRY: &str = "[server]\nhead_s = 0.2\nbody_idle_s = 0.2\nanswer_idle_s = 0.2\nidle_s = 0.4";

async fn connected(server: &Server) -> TcpStream {
    TcpStream::connect(server.url.trim_start_matches("http://")).await.unwrap()
}

/// Everything that comes until the server hangs up.
async fn rest(stream: &mut TcpStream) -> String {
    let mut bytes = Vec::new();
    // A connection that is torn up is let go, too.
    let _ = timeout(LONG, stream.read_to_end(&mut bytes)).await.expect("the server hangs up");
    String::from_utf8(bytes).unwrap()
}

#[tokio::test]
async fn a_head_that_never_ends_is_given_up_however_it_drips() {
    let server = Server::start_with(HURRY).await;
    let (mut silent, mut dripping) = (connected(&server).await, connected(&server).await);
    silent.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\n").await.unwrap();
    let dripped = async {
        let mut drops = b"GET /healthz HTTP/1.1\r\nx: ".iter().chain(std::iter::repeat(&b'y'));
        while dripping.write_all(&[*drops.next().unwrap()]).await.is_ok() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(LONG, dripped).await.expect("the server hangs up");
    assert_eq!(rest(&mut silent).await, "");
    server.stop().await;
}

#[tokio::test]
async fn a_connection_that_asks_nothing_more_is_closed_and_one_that_waits_for_its_answer_is_not() {
    let server = Server::start_with(HURRY).await;
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "", &crate::support::events::events("e", 8, 12.0)).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    let (mut idle, mut waiting) = (connected(&server).await, connected(&server).await);
    idle.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\n\r\n").await.unwrap();
    waiting
        .write_all(b"GET /v1/models/default/tasks/t1?wait_s=1.5 HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n")
        .await
        .unwrap();
    let answered = rest(&mut idle).await;
    assert!(answered.starts_with("HTTP/1.1 200 ") && answered.ends_with("{\"status\":\"ok\"}"), "{answered}");
    let waited = rest(&mut waiting).await;
    assert!(waited.starts_with("HTTP/1.1 200 ") && waited.contains("\"queued\""), "{waited}");
    server.stop().await;
}

#[tokio::test]
async fn a_body_that_dawdles_is_answered_408() {
    let server = Server::start_with("[server]\nbody_idle_s = 0.3\nbody_bytes_per_s = 1000").await;
    for path in ["/v1/models", "/v1/models/default/batches"] {
        let mut stream = connected(&server).await;
        let head = format!(
            "POST {path} HTTP/1.1\r\nhost: x\r\ncontent-type: application/json\r\ncontent-length: 100000\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).await.unwrap();
        let (mut reading, mut writing) = stream.split();
        let drip = async {
            while writing.write_all(b" ").await.is_ok() {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        let mut answer = [0; 12];
        let read = async { reading.read_exact(&mut answer).await.unwrap() };
        tokio::select! {
            _ = timeout(LONG, read) => {}
            () = drip => panic!("hung up without an answer"),
        }
        assert_eq!(answer, *b"HTTP/1.1 408", "{path}");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_client_that_never_reads_is_hung_up_on() {
    let server = Server::start_with(HURRY).await;
    server.learn("default", "fast", &crate::support::events::events("e", 12, 12.0)).await;
    let body = json!({"windows": vec![window(5, 11.0); 200]}).to_string();
    let request = format!(
        "POST /v1/models/default/predict HTTP/1.1\r\nhost: x\r\ncontent-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    );
    let mut stream = connected(&server).await;
    let asking = async { while stream.write_all(request.as_bytes()).await.is_ok() {} };
    timeout(LONG, asking).await.expect("the server hangs up");
    server.get("/healthz").await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn more_connections_than_the_server_keeps_are_told_so_and_find_room_later() {
    let server = Server::start_with("[server]\nconnections = 2").await;
    let ask = b"GET /healthz HTTP/1.1\r\nhost: x\r\n\r\n";
    let (mut first, mut second) = (connected(&server).await, connected(&server).await);
    for stream in [&mut first, &mut second] {
        stream.write_all(ask).await.unwrap();
        assert_eq!(stream.read_u8().await.unwrap(), b'H');
    }
    let mut third = connected(&server).await;
    third.write_all(ask).await.unwrap();
    let told = rest(&mut third).await;
    let (head, body) = told.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 503 ") && head.contains("\r\nretry-after: 1\r\n"), "{head}");
    assert!(head.ends_with(&format!("\r\ncontent-length: {}", body.len())), "{told}");
    let problem: serde_json::Value = serde_json::from_str(body).unwrap();
    assert_eq!((&problem["status"], &problem["code"]), (&json!(503), &json!("busy")));
    drop(first);
    let retried = async {
        loop {
            let mut again = connected(&server).await;
            again.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n").await.unwrap();
            if rest(&mut again).await.starts_with("HTTP/1.1 200 ") {
                break;
            }
        }
    };
    timeout(LONG, retried).await.expect("a place is free");
    drop(second);
    server.stop().await;
}

#[tokio::test]
async fn who_is_one_too_many_to_be_told_is_hung_up_on() {
    let server = Server::start_with("[server]\nconnections = 1\nrefused_at_once = 0").await;
    let mut first = connected(&server).await;
    first.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\n\r\n").await.unwrap();
    assert_eq!(first.read_u8().await.unwrap(), b'H');
    assert_eq!(rest(&mut connected(&server).await).await, "");
    drop(first);
    server.stop().await;
}
