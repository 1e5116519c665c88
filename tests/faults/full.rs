use std::io::{BufRead, BufReader};
use std::os::unix::fs::symlink;
use std::path::Path;

use headway::car_following::TrafficRegime;
use reqwest::Method;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use serde_json::{Value, json};

use crate::SETTINGS;
use crate::process::{Home, Process, Reply};
use crate::remains::Remains;
use crate::traffic::lines;

const MODEL: &str = "/v1/models/default";

/// Lets no file of this process grow beyond so many bytes; `None` takes the limit away.
fn limit_files(process: &Process, bytes: Option<u64>) {
    let pid = Pid::from_raw(process.pid().cast_signed()).unwrap();
    prlimit(Some(pid), Resource::Fsize, Rlimit { current: bytes, maximum: None }).unwrap();
}

/// Uploads so many events, which depend on the seed.
pub(crate) async fn upload(process: &Process, seed: u64, events: usize) -> Reply {
    let request = process.request(Method::POST, &format!("{MODEL}/batches?regime=fast"));
    let request = request.header("content-type", "application/x-ndjson").header("idempotency-key", format!("u{seed}"));
    process.send(request.body(lines(TrafficRegime::Fast, seed, events).concat())).await
}

/// A window to predict.
pub(crate) fn window() -> Value {
    json!({"follower_speed_mps": [9, 9, 9, 9, 9], "leader_speed_mps": [8, 8, 8, 8, 8],
        "spacing_m": [14, 13.9, 13.8, 13.7, 13.6]})
}

/// What the live version predicts.
pub(crate) async fn predicted(process: &Process) -> Value {
    process.post(&format!("{MODEL}/predict"), &json!({"windows": [window()]})).await.expect(200)
}

/// The largest file of the database.
fn largest_bytes(database: &Path) -> u64 {
    ["db", "db-wal"]
        .map(|extension| std::fs::metadata(database.with_extension(extension)).unwrap().len())
        .into_iter()
        .max()
        .unwrap()
}

/// A server with a version that serves.
pub(crate) async fn learned(home: &Home) -> Process {
    let process = home.start();
    upload(&process, 1, 24).await.expect(201);
    process.post(&format!("{MODEL}/tasks"), &json!({"batches": "pending"})).await.expect(202);
    assert_eq!(process.end_of("t1").await["state"], "succeeded");
    process
}

fn settings() -> Vec<&'static str> {
    [&SETTINGS[..], &["model.schedule=manual", "model.epochs=1", "training.checkpoint_s=0.05"]].concat()
}

#[tokio::test]
async fn a_full_disk_is_answered_507_and_nothing_is_lost_when_there_is_room_again() {
    let home = Home::new(&settings());
    let process = learned(&home).await;
    let before = predicted(&process).await;
    limit_files(&process, Some(largest_bytes(&home.database())));
    for (seed, events) in [(2, 40), (3, 400), (2, 40)] {
        let refused = upload(&process, seed, events).await.expect(507);
        assert_eq!(refused["code"], "storage_full", "{refused}");
    }
    assert_eq!(predicted(&process).await, before);
    assert_eq!(process.list(&format!("{MODEL}/batches"), "batches").await.len(), 1);
    limit_files(&process, None);
    upload(&process, 2, 40).await.expect(201);
    upload(&process, 3, 400).await.expect(201);
    process.post(&format!("{MODEL}/tasks"), &json!({"batches": "pending"})).await.expect(202);
    assert_eq!(process.end_of("t2").await["state"], "succeeded");
    drop(process);
    let mut remains = Remains::of(&home).await;
    remains.check().await;
    assert_eq!(remains.count("batch").await, 3);
    remains.close().await;
}

#[tokio::test]
async fn a_task_that_finds_the_disk_full_ends_well_once_there_is_room() {
    let (undisturbed, home) = (Home::new(&settings()), Home::new(&settings()));
    let weights = async |process: &Process| process.get(&format!("{MODEL}/versions/2")).await["weights_sha256"].clone();
    let wish = json!({"batches": ["b1"], "settings": {"epochs": 60}});
    let expected = {
        let process = learned(&undisturbed).await;
        process.post(&format!("{MODEL}/tasks"), &wish).await.expect(202);
        assert_eq!(process.end_of("t2").await["state"], "succeeded");
        weights(&process).await
    };
    let process = learned(&home).await;
    process.post(&format!("{MODEL}/tasks"), &wish).await.expect(202);
    limit_files(&process, Some(largest_bytes(&home.database())));
    while !home.log().contains("cannot grow") {
        tokio::task::yield_now().await;
    }
    limit_files(&process, None);
    assert_eq!(process.end_of("t2").await["state"], "succeeded", "{}", home.log());
    assert_eq!(weights(&process).await, expected);
}

#[test]
fn a_log_that_cannot_be_written_stops_nobody() {
    let home = Home::new(&[&SETTINGS[..], &["log.filter=info"]].concat());
    symlink("/dev/full", home.path().join("log")).unwrap();
    let mut child = home.spawn();
    let mut first = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(first.starts_with("listening on "), "{first:?}");
}
