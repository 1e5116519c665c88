use std::time::Duration;

use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use crate::hostile::still_well;
use crate::support::server::Server;

/// What answers at all answers far sooner.
const LONG: Duration = Duration::from_mins(1);

/// What the server says to these bytes, until it hangs up. `over` tells it that nothing more comes.
async fn exchange(server: &Server, bytes: &[u8], over: bool) -> String {
    let mut stream = TcpStream::connect(server.url.trim_start_matches("http://")).await.unwrap();
    let (mut reading, mut writing) = stream.split();
    let mut said = Vec::new();
    let write = async {
        // A server that has heard enough may hang up before everything is said.
        let _ = writing.write_all(bytes).await;
        if over {
            let _ = writing.shutdown().await;
        }
    };
    let read = async { reading.read_to_end(&mut said).await.map(|_| ()) };
    let ((), read) = timeout(LONG, async { tokio::join!(write, read) }).await.expect("the server hangs up");
    let said = String::from_utf8(said).unwrap();
    // A connection that is closed on who is still sending is torn up; what was said before is there all the same.
    assert!(
        read.is_ok() || !said.is_empty(),
        "{read:?} to {}",
        String::from_utf8_lossy(&bytes[..bytes.len().min(200)])
    );
    said
}

/// Panics unless these bytes get one answer, of one of these statuses.
async fn told(server: &Server, bytes: impl AsRef<[u8]>, statuses: &[u16]) {
    let bytes = bytes.as_ref();
    let said = exchange(server, bytes, false).await;
    let asked = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]).into_owned();
    let status = said.strip_prefix("HTTP/1.1 ").and_then(|rest| rest.get(..3)?.parse().ok()).unwrap_or(0);
    assert!(statuses.contains(&status), "{asked:?}: {said:?}");
    assert_eq!(said.matches("HTTP/1.1 ").count(), 1, "{asked:?}: {said:?}");
}

/// A request to make a model, whose head has these lines, and what follows the head.
fn asking(lines: &str, body: &str) -> String {
    format!(
        "POST /v1/models HTTP/1.1\r\nhost: x\r\nconnection: close\r\ncontent-type: application/json\r\n{lines}\r\n{body}"
    )
}

#[tokio::test]
async fn lengths_that_lie_are_refused() {
    let server = Server::start().await;
    let body = json!({"model": "a", "method": "naive"}).to_string();
    for length in ["-1", "+5", "0x10", "abc", "", "5, 6", "18446744073709551616", "99999999999999999999999"] {
        told(&server, asking(&format!("content-length: {length}\r\n"), &body), &[400]).await;
    }
    told(&server, asking("content-length: 9\r\ncontent-length: 10\r\n", &body), &[400]).await;
    for length in [1_u64 << 40, u64::MAX - 2] {
        told(&server, asking(&format!("content-length: {length}\r\n"), &body), &[413, 400]).await;
    }
    // Shorter than what is there: what is read is cut.
    told(&server, asking("content-length: 5\r\n", &body), &[400]).await;
    for chunks in
        ["zz\r\n{}\r\n", "-1\r\n{}\r\n", "fffffffffffffffff\r\n{}", "2{}\r\n0\r\n\r\n", "2\r\n{}0\r\n\r\n", "\r\n"]
    {
        told(&server, asking("transfer-encoding: chunked\r\n", chunks), &[400]).await;
    }
    for coding in ["gzip", "chunked, gzip", "identity", "chunked;x", "xchunked"] {
        told(&server, asking(&format!("transfer-encoding: {coding}\r\n"), &body), &[400]).await;
    }
    // Longer than what comes, and chunks that never end.
    for (line, sent) in [("content-length: 5000\r\n", &*body), ("transfer-encoding: chunked\r\n", "ffffff\r\n{")] {
        let said = exchange(&server, asking(line, sent).as_bytes(), true).await;
        assert!(said.is_empty() || said.starts_with("HTTP/1.1 400 "), "{said}");
    }
    server.get("/v1/models/a").await.expect(404);
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn of_two_lengths_at_once_nothing_is_smuggled() {
    let server = Server::start().await;
    let smuggled = "POST /v1/models/default/pause HTTP/1.1\r\nhost: x\r\ncontent-length: 0\r\n\r\n";
    let (length, chunked) = ("content-length: 5\r\n", "transfer-encoding: chunked\r\n");
    for lines in
        [format!("{length}{chunked}"), format!("{chunked}{length}"), format!("{chunked}content-length: 500\r\n")]
    {
        // The length is passed over, and nothing that follows is taken for a request.
        let asked = asking(&lines, &format!("0\r\n\r\n{smuggled}")).replace("connection: close\r\n", "");
        told(&server, asked, &[400]).await;
    }
    assert_eq!(server.get("/v1/models/default").await.expect(200)["paused"], false);
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn heads_that_are_too_long_or_no_http_are_refused() {
    let server = Server::start().await;
    let roomy = Server::start_with("[server]\nhead_bytes = 300_000").await;
    let head = |line: &str, more: &str| format!("{line}\r\nhost: x\r\nconnection: close\r\n{more}\r\n");
    told(&server, head("GET /healthz HTTP/1.1", &format!("x: {}\r\n", "y".repeat(4 << 20))), &[431]).await;
    told(&server, head("GET /healthz HTTP/1.1", &format!("{}: y\r\n", "x".repeat(100_000))), &[400, 431]).await;
    told(&server, head("GET /healthz HTTP/1.1", &"x: y\r\n".repeat(5000)), &[431]).await;
    told(&server, head(&format!("GET /{} HTTP/1.1", "y".repeat(4 << 20)), ""), &[431]).await;
    // How long a head may be is a setting, how long a path may be is not.
    for (length, of_server, of_roomy) in [(60_000, 200, 200), (140_000, 431, 200), (620_000, 431, 431)] {
        let long = head("GET /healthz HTTP/1.1", &format!("x: {}\r\n", "y".repeat(length)));
        told(&server, &long, &[of_server]).await;
        told(&roomy, &long, &[of_roomy]).await;
    }
    told(&roomy, head(&format!("GET /{} HTTP/1.1", "y".repeat(70_000)), ""), &[414]).await;
    roomy.stop().await;
    for more in ["x\r\n", ": y\r\n", "x : y\r\n", "x: \0\r\n", "x: a\x01\r\n", " folded\r\n", "\u{e9}: y\r\n"] {
        told(&server, head("GET /healthz HTTP/1.1", more), &[400]).await;
    }
    for line in [
        "GET /healthz HTTP/3.0",
        "GET /healthz",
        "GET  /healthz HTTP/1.1",
        "GET /health\0z HTTP/1.1",
        "GET /health\x01z HTTP/1.1",
        "GET /health\tz HTTP/1.1",
        "G\0T /healthz HTTP/1.1",
        "\u{16}\u{3}\u{1}\u{2}\u{0}\u{1}",
        "PRI * HTTP/2.0",
    ] {
        told(&server, head(line, ""), &[400]).await;
    }
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn paths_and_methods_that_name_nothing_are_not_found() {
    let server = Server::start().await;
    let head = |line: &str| format!("{line} HTTP/1.1\r\nhost: x\r\nconnection: close\r\ncontent-length: 0\r\n\r\n");
    for path in [
        "/../../etc/passwd",
        "/v1/models/../../../etc/passwd",
        "/v1/models/..",
        "/v1/models/%2e%2e/versions",
        "/v1/models/..%2f..%2fetc%2fpasswd",
        "/v1/models/default%2fversions",
        "/v1%2fmodels",
        "/v1/models/%00",
        "/v1/models/default%00",
        "/v1/models/%0d%0ax:y",
        "/v1/models/%ff%fe",
        "/v1/models/%",
        "/v1/models/%zz",
        "//v1//models",
        "/v1/models/default/versions/%31%00",
        "/v1/models/default/tasks/t1%2fcancel",
        "/v1/models/default/sources/%00/release",
    ] {
        for method in ["GET", "POST", "DELETE"] {
            told(&server, head(&format!("{method} {path}")), &[400, 404, 405, 415]).await;
        }
    }
    let name = "n".repeat(60_000);
    told(&server, head(&format!("GET /v1/models/{name}")), &[404]).await;
    told(&server, head(&format!("GET /v1/models/default/batches?page_token={name}")), &[400, 422]).await;
    told(&server, head(&format!("GET /v1/models?{}", "a=b&".repeat(15_000))), &[400, 422]).await;
    for method in ["BREW", "get", "TRACE", "CONNECT", "PROPFIND"] {
        told(&server, head(&format!("{method} /v1/models")), &[400, 404, 405]).await;
    }
    told(&server, head("GET http://elsewhere/v1/models/nobody"), &[404]).await;
    told(&server, head("CONNECT elsewhere:443"), &[400, 404, 405]).await;
    told(&server, head("OPTIONS *"), &[400, 404, 405]).await;
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn who_sends_too_much_hears_so_before_the_server_hangs_up() {
    let server = Server::start_with("[server]\njson_body_bytes = 1000\n[ingest]\nmax_body_bytes = 100_000").await;
    let rest = " ".repeat(8 << 20);
    for path in ["/v1/models", "/v1/models/default/batches", "/v1/models/default/predict", "/v1/nowhere"] {
        for (line, body) in [
            (format!("content-length: {}\r\n", rest.len()), rest.clone()),
            ("transfer-encoding: chunked\r\n".to_owned(), format!("{:x}\r\n{rest}\r\n0\r\n\r\n", rest.len())),
        ] {
            let asked = asking(&line, &body).replacen("/v1/models", path, 1);
            told(&server, &asked, &[413, 404, 409]).await;
            // Who listens only once all is said hears it as well.
            let mut stream = TcpStream::connect(server.url.trim_start_matches("http://")).await.unwrap();
            let _ = timeout(LONG, stream.write_all(asked.as_bytes())).await.expect("the server listens or hangs up");
            let mut said = [0; 12];
            timeout(LONG, stream.read_exact(&mut said)).await.expect("an answer").unwrap();
            assert!(said.starts_with(b"HTTP/1.1 4"), "{path}");
        }
    }
    still_well(&server, "after").await;
    server.stop().await;
}
