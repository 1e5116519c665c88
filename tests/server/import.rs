use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, Row, query};

use super::uploads::{gzip, ndjson, parquet};
use crate::support::events::events;
use crate::support::server::Server;

/// Runs the command line, with a spool of its own.
fn import(directory: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("HEADWAY_")) {
        command.env_remove(name);
    }
    command.env("HEADWAY_INGEST__SPOOL_FOLDER", directory).env("HEADWAY_MODEL__HORIZON", "5");
    command.env("HEADWAY_MODEL__SCHEDULE", "{ min_events = 8, max_wait_s = 3600 }");
    command.arg("import").args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// The text with one space where there are several.
fn narrow(text: &str) -> String {
    text.split(' ').filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Files of every kind, and one that is none.
fn files(directory: &Path) -> Vec<PathBuf> {
    let golden =
        |name: &str| fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/scenes").join(name)).unwrap();
    let mut bad = events("bad", 2, 12.0);
    bad[1]["spacing_m"][3] = json!(-1.0);
    let json = serde_json::to_vec(&json!({"events": events("json", 3, 10.0)})).unwrap();
    let lines = zstd::encode_all(&ndjson(&bad)[..], 1).unwrap();
    let kept = [
        ("events.json", json),
        ("lines.ndjson.zst", lines),
        ("again.jsonl.gz", gzip(&ndjson(&events("json", 3, 10.0)))),
        ("fcd.xml.gz", golden("fcd.xml.gz")),
        ("rows.parquet", parquet(&events("rows", 2, 14.0))),
    ];
    let keep = |(name, bytes): (&str, Vec<u8>)| {
        let path = directory.join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    kept.into_iter().map(keep).collect()
}

/// Everything stored of the events, in the order in which it was stored, but for the time.
async fn stored(database: &Path) -> Vec<(String, Vec<u8>, Option<String>, String, String)> {
    let mut connection = SqliteConnectOptions::new().filename(database).read_only(true).connect().await.unwrap();
    let all = "select name, arrays, run, split, regime, state from event order by event_id";
    let rows = query(all).fetch_all(&mut connection).await.unwrap();
    connection.close().await.unwrap();
    let of = |row: &sqlx::sqlite::SqliteRow| {
        let regime: (String, String) = (row.get(4), row.get(5));
        (row.get(0), row.get(1), row.get(2), row.get(3), format!("{} {}", regime.0, regime.1))
    };
    rows.iter().map(of).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn files_are_stored_alike_in_a_database_and_at_a_server() {
    let (directory, local) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let database = local.path().join("headway.db");
    let files = files(directory.path());
    let mut arguments: Vec<&str> = files.iter().map(|file| file.to_str().unwrap()).collect();
    arguments.extend(["--regime", "fast", "--source", "a site", "--json"]);
    // The rows of the table state no step.
    let arguments = [arguments, vec!["--preset", "headway"]].concat();
    let here = import(directory.path(), &[&arguments[..], &["--database", database.to_str().unwrap()]].concat());
    let settings = "[model]\nschedule = { min_events = 8, max_wait_s = 3600 }";
    let server = Server::start_with(settings).await;
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    let there = import(directory.path(), &[&arguments[..], &["--server", &server.url]].concat());
    let parsed = |output: &Output| -> Value {
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(&output.stderr)))
    };
    let (here_said, there_said) = (parsed(&here), parsed(&there));
    assert_eq!(here_said, there_said);
    // A table without steps is refused event by event, and that is told by the code.
    assert!(!here.status.success() && !there.status.success());
    let files = here_said["files"].as_array().unwrap();
    let taken: Vec<_> = files.iter().map(|file| file["taken"].as_bool().unwrap()).collect();
    assert_eq!(taken, [true, true, true, true, false]);
    let counts = |at: usize| {
        let receipt = &files[at]["receipt"];
        ["accepted", "duplicates", "rejected_count"].map(|member| receipt[member].as_u64().unwrap())
    };
    assert_eq!(
        [counts(0), counts(1), counts(2), counts(3), counts(4)],
        [[3, 0, 0], [1, 0, 1], [0, 3, 0], [6, 0, 0], [0, 0, 2]]
    );
    assert_eq!(files[3]["receipt"]["task_ids"], json!(["t1"]), "the schedule finds ten events due");
    assert_eq!(files[3]["receipt"]["summary"]["extraction"]["events"], 6);
    let kept = server.stop().await;
    let (of_database, of_server) = (stored(&database).await, stored(&kept.path().join("headway.db")).await);
    assert_eq!(of_database.len(), 10);
    assert!(of_database == of_server);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_person_is_told_what_was_taken_and_what_was_not() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("headway.db");
    let files = files(directory.path());
    let named = |at: usize| files[at].to_str().unwrap();
    let run = |arguments: &[&str]| {
        import(directory.path(), &[arguments, &["--database", database.to_str().unwrap()]].concat())
    };
    let good = run(&[named(0), named(1), named(3)]);
    let said = text(&good.stdout);
    assert!(good.status.success(), "{said}{}", text(&good.stderr));
    for wanted in [
        "FILE BATCH ACCEPTED DUPLICATES REJECTED STEPS TASKS",
        "events.json b1 3 0 0 120 –",
        "lines.ndjson.zst b2 1 0 1",
        "rejected bad-1 (line 2): spacing_not_positive: ",
        "fcd.xml.gz b3 6 0 0 2422 t1",
        "6 events out of ",
        "no_leader 824",
    ] {
        assert!(narrow(&said).contains(wanted), "{wanted}:\n{said}");
    }
    let (cut, other) = (directory.path().join("cut.json"), directory.path().join("events.txt"));
    fs::write(&cut, &fs::read(&files[0]).unwrap()[..50]).unwrap();
    fs::write(&other, "").unwrap();
    let bad = run(&[cut.to_str().unwrap(), other.to_str().unwrap(), "absent.csv", named(0)]);
    let said = text(&bad.stdout);
    assert!(!bad.status.success());
    assert!(text(&bad.stderr).contains("3 of 4 files were refused"), "{}", text(&bad.stderr));
    for wanted in ["truncated_body", "ends in none of .json", "No such file", "events.json b4 0 3 0"] {
        assert!(narrow(&said).contains(wanted), "{wanted}:\n{said}");
    }
    let option = run(&[named(0), "--min-duration-s", "5"]);
    assert!(!option.status.success() && text(&option.stdout).contains("option_not_applicable"));
    assert!(!run(&[named(0), "--preset", "mine"]).status.success());
    let nobody = run(&[named(0), "--model", "nobody"]);
    assert!(text(&nobody.stderr).contains("no model is called \"nobody\""), "{}", text(&nobody.stderr));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_database_that_a_server_owns_is_left_to_it_and_the_server_wants_a_key() {
    let directory = tempfile::tempdir().unwrap();
    let file = files(directory.path()).remove(0);
    let file = file.to_str().unwrap();
    let mut server = Server::start().await;
    let database = server.directory.path().join("headway.db");
    let owned = import(directory.path(), &[file, "--database", database.to_str().unwrap()]);
    assert!(!owned.status.success() && text(&owned.stderr).contains("use --server URL"), "{}", text(&owned.stderr));
    server.close_gate().await;
    let key = server.make_key(&json!({"scopes": ["ingest"]})).await;
    let path = directory.path().join("key");
    fs::write(&path, format!("{key}\n")).unwrap();
    let stranger = import(directory.path(), &[file, "--server", &server.url]);
    assert!(!stranger.status.success() && text(&stranger.stderr).contains("401"), "{}", text(&stranger.stderr));
    let known = import(directory.path(), &[file, "--server", &server.url, "--key-file", path.to_str().unwrap()]);
    assert!(known.status.success() && narrow(&text(&known.stdout)).contains(" b1 3 "), "{}", text(&known.stderr));
    let elsewhere = import(directory.path(), &[file, "--server", &server.url, "--key", &key, "--model", "nobody"]);
    assert!(text(&elsewhere.stderr).contains("404"), "{}", text(&elsewhere.stderr));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_taken_before_the_server_refuses_to_go_on_is_told() {
    let directory = tempfile::tempdir().unwrap();
    let files = files(directory.path());
    let mut server = Server::start_with("[access]\nrate_window_s = 86400\nrate_requests = 2").await;
    server.close_gate().await;
    let key = server.make_key(&json!({"scopes": ["ingest"]})).await;
    let named: Vec<&str> = files[..3].iter().map(|file| file.to_str().unwrap()).collect();
    let stopped = import(directory.path(), &[&named[..], &["--server", &server.url, "--key", &key]].concat());
    let (said, why) = (text(&stopped.stdout), text(&stopped.stderr));
    assert!(!stopped.status.success());
    assert!(said.contains(" b1 ") && said.contains(" b2 ") && !said.contains("again.jsonl.gz"), "{said}");
    assert!(why.contains("again.jsonl.gz nor a file after it was imported") && why.contains("429"), "{why}");
    server.stop().await;
}
