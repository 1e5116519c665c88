use std::fmt::Write as _;
use std::time::Duration;

use reqwest::Method;
use serde_json::{Value, json};
use tokio::time::timeout;

use crate::support::events::{event, events, window};
use crate::support::server::{Answer, Server};
use crate::uploads::{gzip, ndjson, parquet, send};

/// What answers at all answers far sooner.
const LONG: Duration = Duration::from_mins(1);
pub(crate) const JSON: &str = "application/json";
pub(crate) const LINES: &str = "application/x-ndjson";
pub(crate) const CSV: &str = "text/csv";
pub(crate) const PARQUET: &str = "application/vnd.apache.parquet";
const ARRAY: &str = "application/x-npy";
const MODEL: &str = "/v1/models/default";

/// The server is as it was: it answers, and takes an honest upload.
pub(crate) async fn still_well(server: &Server, name: &str) {
    server.get("/healthz").await.expect(200);
    server.upload("default", "", &[event(name, 12.0, "train")]).await.expect(201);
}

async fn post(server: &Server, path: &str, kind: &str, body: impl Into<Vec<u8>>) -> Answer {
    let request = server.request(Method::POST, path).header("content-type", kind).body(body.into());
    timeout(LONG, server.send(request)).await.expect("an answer")
}

#[track_caller]
fn refused(answer: &Answer, what: &str) {
    assert!((400..500).contains(&answer.status), "{what}: {}", answer.text);
}

#[tokio::test]
async fn json_nested_without_end_is_refused_wherever_it_comes() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 12.0)).await;
    let deep = [("[", "]"), ("{\"a\":", "}")].map(|(open, close)| open.repeat(100_000) + "1" + &close.repeat(100_000));
    for deep in &deep {
        for open in [deep.clone(), deep[..deep.len() / 2].to_owned()] {
            for (path, member) in [
                ("/predict", "windows"),
                ("/simulate", "initial"),
                ("/tasks", "batches"),
                ("/batches", "events"),
                ("/evaluate?versions=1", "events"),
            ] {
                let path = format!("{MODEL}{path}");
                refused(&post(&server, &path, JSON, open.clone()).await, &path);
                let body = format!("{{\"{member}\": {open}}}");
                refused(&post(&server, &path, JSON, body).await, &path);
                let body = format!("{{\"{member}\": [{open}]}}");
                refused(&post(&server, &path, JSON, body).await, &path);
            }
            for member in ["model", "settings", "method"] {
                refused(&post(&server, "/v1/models", JSON, format!("{{\"{member}\": {open}}}")).await, member);
            }
            for line in [open.clone(), format!("{{\"spacing_m\": {open}}}"), format!("{{\"colour\": {open}}}")] {
                refused(&post(&server, &format!("{MODEL}/batches"), LINES, line).await, "a line");
            }
        }
    }
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn pickles_that_would_run_something_or_take_everything_are_refused() {
    let server = Server::start().await;
    let corpus = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/npy");
    let mut refused_of = [0; 3];
    for entry in std::fs::read_dir(corpus).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        let kinds = ["seed-gadget-", "seed-bomb-", "seed-lie-"];
        let Some(kind) = kinds.iter().position(|kind| name.starts_with(kind)) else { continue };
        let answer =
            post(&server, &format!("{MODEL}/batches?preset=follownet"), ARRAY, std::fs::read(&path).unwrap()).await;
        refused(&answer, name);
        if kind == 0 {
            answer.expect_problem(422, "invalid_body");
        }
        refused_of[kind] += 1;
    }
    assert!(refused_of.iter().all(|&count| count > 30), "{refused_of:?}");
    assert!(!std::path::Path::new("headway-ran-this").exists());
    assert_eq!(server.get(&format!("{MODEL}/batches")).await.expect(200)["batches"], json!([]));
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn members_that_come_twice_are_refused() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 12.0)).await;
    let window = window(5, 11.0).to_string();
    let twice = window.replacen('{', "{\"spacing_m\": [1,2,3,4,5], ", 1);
    let event = event("twice", 12.0, "train").to_string().replacen('{', "{\"dt_s\": 0.1, ", 1);
    for (path, kind, body) in [
        ("/predict", JSON, format!("{{\"windows\": [{window}], \"windows\": [{window}]}}")),
        ("/predict", JSON, format!("{{\"windows\": [{twice}]}}")),
        ("/tasks", JSON, "{\"batches\": \"pending\", \"batches\": \"pending\"}".to_owned()),
        ("/tasks", JSON, "{\"batches\": \"pending\", \"settings\": {\"epochs\": 1, \"epochs\": 2}}".to_owned()),
        ("/batches", JSON, "{\"events\": [], \"events\": []}".to_owned()),
        ("/batches", JSON, format!("{{\"events\": [{event}]}}")),
        ("/batches", LINES, event),
        ("/batches", CSV, "event_id,spacing_m,spacing_m,follower_speed_mps,leader_speed_mps\n".to_owned()),
    ] {
        refused(&post(&server, &format!("{MODEL}{path}"), kind, body.clone()).await, &body);
    }
    for body in [
        r#"{"model": "a", "model": "b", "method": "ewc"}"#,
        r#"{"model": "a", "method": "ewc", "settings": {"hidden": 3, "hidden": 4}}"#,
    ] {
        refused(&post(&server, "/v1/models", JSON, body).await, body);
    }
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn numbers_that_are_none_are_refused_in_every_text() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 12.0)).await;
    let honest = event("odd", 12.0, "train");
    for number in ["NaN", "nan", "Infinity", "-Infinity", "inf", "-inf", "1e999", "-1e999", "1e308", "01", "0x10", "+1"]
    {
        let mut odd = honest.clone();
        odd["spacing_m"][7] = json!("ODD");
        let body = json!({"events": [odd]}).to_string().replace("\"ODD\"", number);
        refused(&post(&server, &format!("{MODEL}/batches"), JSON, body).await, number);
        let line = odd.to_string().replace("\"ODD\"", number);
        refused(&post(&server, &format!("{MODEL}/batches"), LINES, line).await, number);
        let mut body = json!({"windows": [window(5, 11.0)]});
        body["windows"][0]["spacing_m"][2] = json!("ODD");
        let body = body.to_string().replace("\"ODD\"", number);
        refused(&post(&server, &format!("{MODEL}/predict"), JSON, body).await, number);
    }
    for number in ["NaN", "nan", "Infinity", "-inf", "inf", "1e999", "1e308", "0x10", "9".repeat(400).as_str()] {
        refused(&post(&server, &format!("{MODEL}/batches"), CSV, csv(&honest, number)).await, number);
    }
    let huge = "9".repeat(400);
    let body = json!({"windows": [window(5, 11.0)]}).to_string().replacen("20.0", &huge, 1);
    refused(&post(&server, &format!("{MODEL}/predict"), JSON, body).await, "a huge integer");
    // Minus zero is a number.
    let body = json!({"windows": [window(5, 11.0)]}).to_string().replacen("11.0", "-0", 1);
    post(&server, &format!("{MODEL}/predict"), JSON, body).await.expect(200);
    still_well(&server, "after").await;
    server.stop().await;
}

/// One event's rows, with `number` as a spacing in their midst.
fn csv(event: &Value, number: &str) -> String {
    let mut text = "event_id,dt_s,spacing_m,follower_speed_mps,leader_speed_mps\n".to_owned();
    for step in 0..40 {
        let spacing = if step == 20 { number.to_owned() } else { event["spacing_m"][step].to_string() };
        let (own, leader) = (&event["follower_speed_mps"][step], &event["leader_speed_mps"][step]);
        writeln!(text, "odd,0.1,{spacing},{own},{leader}").unwrap();
    }
    text
}

#[tokio::test]
async fn text_that_is_no_utf_8_is_refused_in_every_format() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 12.0)).await;
    let honest = event("odd", 12.0, "train");
    let spoilt = |text: String| text.replace("odd", "o#d").bytes().map(|b| if b == b'#' { 0xff } else { b }).collect();
    let bodies: [(&str, &str, Vec<u8>); 5] = [
        ("/batches", JSON, spoilt(json!({"events": [honest]}).to_string())),
        ("/batches", LINES, spoilt(honest.to_string())),
        ("/batches", CSV, spoilt(csv(&honest, "20.0"))),
        (
            "/batches",
            PARQUET,
            parquet(&[event("ODD", 12.0, "train")]).iter().map(|&b| if b == b'O' { 0xff } else { b }).collect(),
        ),
        ("/predict", JSON, spoilt("{\"odd\": 1}".to_owned())),
    ];
    for (path, kind, body) in bodies {
        refused(&post(&server, &format!("{MODEL}{path}"), kind, body).await, kind);
    }
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn a_small_body_that_would_grow_beyond_the_limit_is_refused() {
    let server = Server::start_with("[ingest.limits]\nmax_decompressed_bytes = 100_000").await;
    let blank = vec![b' '; 20_000_000];
    let lines = vec![b'\n'; 20_000_000];
    let header = b"event_id,spacing_m,follower_speed_mps,leader_speed_mps\n";
    let rows = [&header[..], &b"a,1,1,1\n".repeat(2_000_000)].concat();
    for (kind, body) in
        [(JSON, &blank), (LINES, &lines), (LINES, &blank), (CSV, &rows), (CSV, &blank), (PARQUET, &blank)]
    {
        for (encoding, small) in [("gzip", gzip(body)), ("zstd", zstd::encode_all(&body[..], 3).unwrap())] {
            assert!(small.len() < 400_000, "{} bytes", small.len());
            let answer = timeout(LONG, send(&server, "", kind, Some(encoding), small)).await.expect("an answer");
            answer.expect_problem(413, "body_too_large");
        }
    }
    // Many members, each of which is small.
    let member = [&lines[..1000], &lines[..1000]].map(gzip).concat().repeat(1000);
    send(&server, "", LINES, Some("gzip"), member).await.expect_problem(413, "body_too_large");
    let frame = zstd::encode_all(&lines[..1000], 3).unwrap().repeat(2000);
    send(&server, "", LINES, Some("zstd"), frame).await.expect_problem(413, "body_too_large");
    still_well(&server, "after").await;
    server.stop().await;
}

#[tokio::test]
async fn streams_that_are_cut_corrupt_or_hold_another_stream_are_refused() {
    let server = Server::start().await;
    let lines = ndjson(&events("e", 8, 12.0));
    let (zipped, packed) = (gzip(&lines), zstd::encode_all(&lines[..], 3).unwrap());
    // A frame that wants a window of 2^31 bytes, and frames that hold nothing at all.
    let wide = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0xa8, 0x01, 0x00, 0x00];
    let nothing = [0x50, 0x2a, 0x4d, 0x18, 0, 0, 0, 0].repeat(100_000);
    for (encoding, body) in [
        ("gzip", gzip(&zipped)),
        ("gzip", packed.clone()),
        ("gzip", gzip(b"").repeat(100_000)),
        ("gzip", [&zipped[..], b"more"].concat()),
        ("gzip", vec![]),
        ("zstd", zipped.clone()),
        ("zstd", zstd::encode_all(&packed[..], 3).unwrap()),
        ("zstd", [&packed[..], b"more"].concat()),
        ("zstd", wide),
        ("zstd", nothing),
        ("zstd", vec![]),
    ] {
        refused(&send(&server, "", LINES, Some(encoding), body).await, encoding);
    }
    for (encoding, whole) in [("gzip", &zipped), ("zstd", &packed)] {
        for cut in (1..whole.len()).step_by(whole.len() / 20) {
            refused(&send(&server, "", LINES, Some(encoding), whole[..cut].to_vec()).await, encoding);
        }
    }
    for at in 0..8 {
        let mut corrupt = zipped.clone();
        let end = corrupt.len() - 1;
        corrupt[end - at] ^= 0x10;
        refused(&send(&server, "", LINES, Some("gzip"), corrupt).await, "a digest or length");
    }
    assert_eq!(
        server.get(&format!("{MODEL}/batches")).await["batches"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|b| b["accepted"] != 0)
            .count(),
        0
    );
    still_well(&server, "after").await;
    server.stop().await;
}
