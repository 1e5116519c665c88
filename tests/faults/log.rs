use std::time::{Duration, Instant};

use headway::car_following::TrafficRegime;
use reqwest::Method;
use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, query};

use crate::SETTINGS;
use crate::full::window;
use crate::process::{Home, Process};
use crate::traffic::lines;

const MODEL: &str = "/v1/models/default";

/// Bytes that the write-ahead log may have before a change.
const MOST: u64 = 262_144;

/// A server with a version that serves.
async fn learned() -> (Home, Process) {
    let own = ["model.schedule=manual", "model.epochs=1", "database.log_bytes=262144", "upkeep.interval_s=0.1"];
    let home = Home::new(&[&SETTINGS[..], &own].concat());
    let process = home.start();
    upload(&process, 1).await;
    process.post(&format!("{MODEL}/tasks"), &json!({"batches": "pending"})).await.expect(202);
    assert_eq!(process.end_of("t1").await["state"], "succeeded");
    (home, process)
}

/// Uploads a batch; gives its bytes.
async fn upload(process: &Process, seed: u64) -> u64 {
    let request = process.request(Method::POST, &format!("{MODEL}/batches?regime=fast"));
    let body = lines(TrafficRegime::Fast, seed, 100).concat();
    let bytes = body.len() as u64;
    process.send(request.header("content-type", "application/x-ndjson").body(body)).await.expect(201);
    bytes
}

fn log_bytes(home: &Home) -> u64 {
    std::fs::metadata(home.database().with_extension("db-wal")).map_or(0, |found| found.len())
}

async fn held_s(process: &Process) -> f64 {
    let metrics = process.send(process.request(Method::GET, "/metrics")).await.text;
    let line = metrics.lines().find_map(|line| line.strip_prefix("headway_database_wal_held_seconds "));
    line.unwrap().parse().unwrap()
}

/// Lists, and predictions by a version that is named and not kept loaded, without end.
async fn read_on(process: &Process) {
    let ask = json!({"windows": [window()], "version": 1});
    loop {
        process.get(&format!("{MODEL}/batches?page_size=1000")).await;
        process.get(&format!("{MODEL}/versions/1/evaluation")).await;
        process.post(&format!("{MODEL}/predict"), &ask).await.expect(200);
    }
}

#[tokio::test]
async fn the_write_ahead_log_stays_short_while_everybody_reads() {
    let (home, process) = learned().await;
    let (mut longest, mut largest, mut written) = (0, 0, 0);
    let uploads = async {
        for seed in 2..16 {
            let bytes = upload(&process, seed).await;
            (largest, written) = (bytes.max(largest), written + bytes);
            longest = log_bytes(&home).max(longest);
        }
    };
    tokio::select! {
        () = uploads => {}
        () = read_on(&process) => {}
        () = read_on(&process) => {}
    }
    assert!(written > 2 * (MOST + 3 * largest), "{written} bytes were uploaded, {largest} at most at once");
    assert!(longest <= MOST + 3 * largest, "the log had {longest} bytes; {largest} were uploaded at once");
}

#[tokio::test]
async fn a_reader_that_does_not_end_is_told_of_and_stops_nobody() {
    let (home, process) = learned().await;
    let options = SqliteConnectOptions::new().filename(home.database()).read_only(true);
    let mut stuck = options.connect().await.unwrap();
    query("begin").execute(&mut stuck).await.unwrap();
    query("select count(*) from event").fetch_one(&mut stuck).await.unwrap();
    let began = Instant::now();
    let mut seed = 2;
    while log_bytes(&home) <= 3 * MOST {
        upload(&process, seed).await;
        seed += 1;
    }
    let within_reason = |what: &str| assert!(began.elapsed() < Duration::from_mins(2), "{what}: {}", home.log());
    while !home.log().contains("keeps the write-ahead log from being emptied") {
        within_reason("it is not told");
        tokio::task::yield_now().await;
    }
    assert!(held_s(&process).await > 0.0);
    stuck.close().await.unwrap();
    while log_bytes(&home) > MOST || held_s(&process).await > 0.0 {
        within_reason("the log is not emptied");
    }
}
