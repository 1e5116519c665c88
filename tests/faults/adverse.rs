use std::fs;
use std::path::PathBuf;

use headway::car_following::TrafficRegime;
use jiff::{Timestamp, ToSpan};
use reqwest::Method;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::SETTINGS;
use crate::full::{learned, predicted, window};
use crate::life::{KEY, let_in};
use crate::preloaded::library;
use crate::process::{Home, Process, Reply};
use crate::remains::Remains;
use crate::traffic::lines;

const MODEL: &str = "/v1/models/default";
const DAY_S: i64 = 86_400;

/// A machine that turns against the process.
struct Machine {
    folder: TempDir,
    library: PathBuf,
}

impl Machine {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let library = library(folder.path(), "adverse.c");
        let machine = Self { folder, library };
        machine.turns(0, 0, false);
        machine
    }

    fn home(&self) -> Home {
        let own = ["model.schedule=manual", "model.epochs=1", "training.checkpoint_s=0.05"];
        let mut home = Home::new(&[&SETTINGS[..], &own].concat());
        home.set_variable("LD_PRELOAD", self.library.to_str().unwrap());
        home.set_variable("ADVERSE", self.folder.path().join("now").to_str().unwrap());
        home
    }

    /// From now on the wall clock is so far off, each sync takes so long, and a database cannot be written or can.
    fn turns(&self, clock_s: i64, sync_ms: u32, read_only: bool) {
        let next = self.folder.path().join("next");
        fs::write(&next, format!("{clock_s} {sync_ms} {}\n", u8::from(read_only))).unwrap();
        fs::rename(next, self.folder.path().join("now")).unwrap();
    }
}

async fn upload(process: &Process, seed: u64, key: &str) -> Reply {
    let request = process.request(Method::POST, &format!("{MODEL}/batches?regime=fast"));
    let request = request.header("content-type", "application/x-ndjson").header("idempotency-key", format!("u{seed}"));
    process.send(request.bearer_auth(key).body(lines(TrafficRegime::Fast, seed, 24).concat())).await
}

async fn get(process: &Process, path: &str) -> Value {
    process.send(process.request(Method::GET, path).bearer_auth(KEY)).await.expect(200)
}

async fn post(process: &Process, path: &str, body: &Value) -> Reply {
    process.send(process.request(Method::POST, path).bearer_auth(KEY).json(body)).await
}

/// The ids of a list, one a page.
async fn ids(process: &Process, plural: &str, id: &str) -> Vec<String> {
    let (mut ids, mut token) = (Vec::new(), String::new());
    loop {
        let page = get(process, &format!("{MODEL}/{plural}?page_size=1{token}")).await;
        ids.extend(page[plural].as_array().unwrap().iter().map(|entry| entry[id].to_string().replace('"', "")));
        match page["next_page_token"].as_str() {
            Some(next) => token = format!("&page_token={next}"),
            None => return ids,
        }
    }
}

/// A list that begins with what is newest, or with what is oldest, as one that begins with the latter.
fn from_the_first(mut ids: Vec<String>) -> Vec<String> {
    if ids.first() > ids.last() {
        ids.reverse();
    }
    ids
}

#[tokio::test]
async fn a_clock_that_is_set_a_day_forward_and_back_loses_nothing_and_keeps_every_order() {
    let machine = Machine::new();
    let mut home = machine.home();
    let_in(&mut home);
    let mut process = home.start();
    let in_an_hour = (Timestamp::now() + 1.hour()).to_string();
    let made = post(&process, "/v1/keys", &json!({"scopes": ["predict"], "expires_at": in_an_hour})).await;
    let key = made.expect(201)["key"].as_str().unwrap().to_owned();
    let mut token: Option<String> = None;
    for (seed, clock_s, opens) in [(1, 0, true), (2, DAY_S, false), (3, -DAY_S, true), (4, 0, true)] {
        machine.turns(clock_s, 0, false);
        let first = upload(&process, seed, KEY).await;
        assert_eq!(first.expect(201)["accepted"], 24, "{}", first.text);
        assert_eq!(upload(&process, seed, KEY).await, first, "the same request, the same answer");
        post(&process, &format!("{MODEL}/tasks"), &json!({"batches": "pending"})).await.expect(202);
        let task = format!("{MODEL}/tasks/t{seed}?wait_s=60");
        while ["queued", "running"].contains(&get(&process, &task).await["state"].as_str().unwrap()) {}
        let task = get(&process, &task).await;
        assert_eq!((&task["state"], &task["version"]), (&json!("succeeded"), &json!(seed)), "{task}");
        if let Some(token) = &token {
            let next = get(&process, &format!("{MODEL}/history?page_size=1&page_token={token}")).await;
            assert_eq!(next["history"].as_array().unwrap().len(), 1, "a page goes on over the step");
        }
        token =
            get(&process, &format!("{MODEL}/history?page_size=1")).await["next_page_token"].as_str().map(Into::into);
        let with_key = process.request(Method::POST, &format!("{MODEL}/predict")).bearer_auth(&key);
        let status = process.send(with_key.json(&json!({"windows": [window()]}))).await.status;
        assert_eq!(status, if opens { 200 } else { 401 }, "a key that expires in an hour, {clock_s} s off");
        process.kill();
        process = home.start();
    }
    for (plural, id, prefix) in
        [("batches", "batch_id", "b"), ("tasks", "task_id", "t"), ("versions", "version", ""), ("history", "live", "")]
    {
        let in_order = [1, 2, 3, 4].map(|number| format!("{prefix}{number}"));
        assert_eq!(from_the_first(ids(&process, plural, id).await), in_order, "{plural}");
    }
    // Its answer may be forgotten by now, as of a day ago; its events are not.
    let again = upload(&process, 1, KEY).await.expect(201);
    assert!(again["batch_id"] == "b1" || again["accepted"] == 0, "{again}");
    drop(process);
    assert!(!home.log().contains("panicked"), "{}", home.log());
    let mut remains = Remains::of(&home).await;
    remains.check().await;
    assert_eq!(remains.count("event").await, 4 * 24);
    remains.close().await;
}

#[tokio::test]
async fn predictions_do_not_wait_for_a_slow_disk_and_what_it_took_is_there() {
    let machine = Machine::new();
    let home = machine.home();
    let mut process = learned(&home).await;
    let expected = predicted(&process).await;
    machine.turns(0, 500, false);
    let wish = json!({"batches": ["b1"], "settings": {"epochs": 30}});
    process.post(&format!("{MODEL}/tasks"), &wish).await.expect(202);
    for seed in 2..5 {
        let mut answered = 0;
        let predictions = async {
            loop {
                let now = predicted(&process).await;
                // The task may have ended meanwhile, and its version serve.
                assert!(now == expected || now["version"] == 2, "{now}");
                answered += 1;
            }
        };
        tokio::select! {
            upload = upload(&process, seed, "") => drop(upload.expect(201)),
            () = predictions => {}
        }
        assert!(answered >= 5, "{answered} predictions while one upload was stored");
    }
    process.kill();
    machine.turns(0, 0, false);
    let process = home.start();
    assert_eq!(process.list(&format!("{MODEL}/batches"), "batches").await.len(), 4);
    assert_eq!(process.end_of("t2").await["state"], "succeeded");
}

#[tokio::test]
async fn a_database_that_cannot_be_written_any_more_is_read_on_and_written_when_it_can() {
    let machine = Machine::new();
    let home = machine.home();
    let process = learned(&home).await;
    let expected = predicted(&process).await;
    machine.turns(0, 0, true);
    for seed in 2..5 {
        let refused = upload(&process, seed, "").await;
        assert!([503, 507].contains(&refused.status), "{}", refused.text);
    }
    let note = process.request(Method::PATCH, &format!("{MODEL}/versions/1")).json(&json!({"note": "kept"}));
    assert!([503, 507].contains(&process.send(note).await.status));
    assert_eq!(predicted(&process).await, expected);
    assert_eq!(process.list(&format!("{MODEL}/batches"), "batches").await.len(), 1);
    process.send(process.request(Method::GET, "/readyz")).await.expect(200);
    machine.turns(0, 0, false);
    for seed in 2..5 {
        upload(&process, seed, "").await.expect(201);
    }
    drop(process);
    let mut remains = Remains::of(&home).await;
    remains.check().await;
    assert_eq!(remains.count("batch").await, 4);
    remains.close().await;
}
