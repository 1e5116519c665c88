use std::fs::File;

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::hostile::PARQUET;
use crate::support::binary::Binary;
use crate::support::events::events;
use crate::uploads::parquet;

/// The real binary, whose log is JSON.
struct Logging {
    directory: TempDir,
    binary: Binary,
}

impl Logging {
    fn start(filter: &str, points: &str) -> Self {
        Self::start_with(filter, points, &[])
    }

    fn start_with(filter: &str, points: &str, settings: &[&str]) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let file = |name: &str| directory.path().join(name);
        let database = file("headway.db");
        let place = ["--listen", "127.0.0.1:0", "--database", database.to_str().unwrap()];
        let filter = format!("log.filter={filter}");
        let arguments = [&place[..], &["--set", "log.format=json", "--set", &filter], settings].concat();
        let binary = Binary::start_with_log(&arguments, points, File::create(file("log")).unwrap());
        Self { directory, binary }
    }

    async fn post(&self, path: &str, kind: &str, body: Vec<u8>) -> u16 {
        let request = reqwest::Client::new().post(format!("{}/v1/models/default/{path}", self.binary.url));
        request.header("content-type", kind).body(body).send().await.unwrap().status().as_u16()
    }

    /// Every line of the log; panics at one that is no JSON.
    fn lines(&self) -> Vec<Value> {
        let log = std::fs::read_to_string(self.directory.path().join("log")).unwrap();
        log.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"))).collect()
    }
}

fn with_message<'a>(lines: &'a [Value], message: &str) -> Vec<&'a Value> {
    lines.iter().filter(|line| line["fields"]["message"] == message).collect()
}

#[tokio::test]
async fn a_library_that_panics_at_a_hostile_body_is_a_line_for_debug_and_no_more() {
    let honest = parquet(&events("m", 3, 11.0));
    for (filter, is_told) in [("info,headway::telemetry=debug", true), ("info", false)] {
        let server = Logging::start(filter, "");
        // The last bit of a number in the footer is its sign, and the library believes that a place in the file has none.
        for at in honest.len() - 400..honest.len() - 8 {
            let mut hostile = honest.clone();
            hostile[at] ^= 1;
            let status = server.post("batches?dt_s=0.1", PARQUET, hostile).await;
            assert!((200..300).contains(&status) || (400..500).contains(&status), "{status}");
        }
        let lines = server.lines();
        let refused = with_message(&lines, "a library refused a body by panicking");
        assert_eq!(!refused.is_empty(), is_told, "{} of {}", refused.len(), lines.len());
        for line in refused {
            assert_eq!(line["level"], "DEBUG");
            assert!(line["fields"]["place"].as_str().unwrap().contains("parquet"), "{line}");
        }
        assert!(lines.iter().all(|line| line["level"] != "ERROR"), "{lines:?}");
    }
}

#[tokio::test]
async fn a_panic_that_nobody_expects_is_an_error_in_the_log_with_its_place() {
    let server = Logging::start("info", "model_paused.before=panic(a bug)");
    assert_eq!(server.post("pause", "application/json", b"{}".to_vec()).await, 500);
    let lines = server.lines();
    let panicked = with_message(&lines, "panicked");
    assert_eq!(panicked.len(), 1, "{lines:?}");
    assert_eq!((&panicked[0]["level"], &panicked[0]["fields"]["cause"]), (&"ERROR".into(), &"a bug".into()));
    assert!(panicked[0]["fields"]["place"].as_str().unwrap().contains(".rs:"), "{}", panicked[0]);
    // It goes on: the next request finds the same bug, and others do not.
    assert_eq!(server.post("resume", "application/json", b"{}".to_vec()).await, 500);
    assert_eq!(reqwest::get(format!("{}/readyz", server.binary.url)).await.unwrap().status(), 200);
}

#[tokio::test]
async fn strangers_are_counted_and_nearly_none_of_them_is_a_line_in_the_log() {
    const STRANGERS: usize = 200;
    let server = Logging::start_with("info", "", &["--set", "access.refusal_log_s=3600"]);
    let client = reqwest::Client::new();
    let ask = |path: &str| client.get(format!("{}{path}", server.binary.url));
    let made = client.post(format!("{}/v1/keys", server.binary.url)).json(&json!({"scopes": ["admin"]}));
    let made: Value = serde_json::from_str(&made.send().await.unwrap().text().await.unwrap()).unwrap();
    for _ in 0..STRANGERS {
        assert_eq!(ask("/v1/models/default").send().await.unwrap().status(), 401);
        assert_eq!(ask("/v1/nowhere").bearer_auth("hw_x").send().await.unwrap().status(), 401);
        assert_eq!(ask("/healthz").send().await.unwrap().status(), 200);
        assert_eq!(ask("/readyz").send().await.unwrap().status(), 200);
    }
    let metrics =
        ask("/metrics").bearer_auth(made["key"].as_str().unwrap()).send().await.unwrap().text().await.unwrap();
    for route in ["/v1/models/{model}", "unmatched"] {
        let count =
            format!("headway_http_requests_total{{route=\"{route}\",method=\"GET\",status=\"401\"}} {STRANGERS}");
        assert!(metrics.contains(&count), "{metrics}");
    }
    let lines = server.lines();
    let refused = with_message(&lines, "refused");
    assert_eq!(refused.len(), 1, "{refused:?}");
    assert_eq!((&refused[0]["fields"]["status"], &refused[0]["fields"]["untold"]), (&401.into(), &0.into()));
    assert!(lines.len() < 20, "{} lines", lines.len());
}
