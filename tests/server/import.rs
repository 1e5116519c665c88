use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, Row, query};

use super::uploads::{gzip, ndjson, parquet};
use crate::support::command::{Said, headway_with};
use crate::support::events::events;
use crate::support::server::Server;

/// Runs the command line, with a spool of its own.
fn import(directory: &Path, arguments: &[&str]) -> Said {
    let variables = [
        ("HEADWAY_INGEST__SPOOL_FOLDER", directory.to_str().unwrap()),
        ("HEADWAY_MODEL__HORIZON", "5"),
        ("HEADWAY_MODEL__SCHEDULE", "{ min_events = 8, max_wait_s = 3600 }"),
    ];
    headway_with(&variables, &[&["import"], arguments].concat())
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
    let parsed = |said: &Said| -> Value { serde_json::from_str(&said.out).unwrap_or_else(|_| panic!("{}", said.err)) };
    let (here_said, there_said) = (parsed(&here), parsed(&there));
    assert_eq!(here_said, there_said);
    // A table without steps is refused event by event, and that is told by the code.
    assert!(!here.success && !there.success);
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
    let said = good.out;
    assert!(good.success, "{said}{}", good.err);
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
    let said = bad.out;
    assert!(!bad.success);
    assert!(bad.err.contains("3 of 4 files were refused"), "{}", bad.err);
    for wanted in ["truncated_body", "ends in none of .json", "No such file", "events.json b4 0 3 0"] {
        assert!(narrow(&said).contains(wanted), "{wanted}:\n{said}");
    }
    let option = run(&[named(0), "--min-duration-s", "5"]);
    assert!(!option.success && option.out.contains("option_not_applicable"));
    assert!(!run(&[named(0), "--preset", "mine"]).success);
    let nobody = run(&[named(0), "--model", "nobody"]);
    assert!(nobody.err.contains("no model is called \"nobody\""), "{}", nobody.err);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_database_that_a_server_owns_is_left_to_it_and_the_server_wants_a_key() {
    let directory = tempfile::tempdir().unwrap();
    let file = files(directory.path()).remove(0);
    let file = file.to_str().unwrap();
    let mut server = Server::start().await;
    let database = server.directory.path().join("headway.db");
    let owned = import(directory.path(), &[file, "--database", database.to_str().unwrap()]);
    assert!(!owned.success && owned.err.contains("use --server URL"), "{}", owned.err);
    server.close_gate().await;
    let key = server.make_key(&json!({"scopes": ["ingest"]})).await;
    let path = directory.path().join("key");
    fs::write(&path, format!("{key}\n")).unwrap();
    let stranger = import(directory.path(), &[file, "--server", &server.url]);
    assert!(!stranger.success && stranger.err.contains("401"), "{}", stranger.err);
    let known = import(directory.path(), &[file, "--server", &server.url, "--key-file", path.to_str().unwrap()]);
    assert!(known.success && narrow(&known.out).contains(" b1 3 "), "{}", known.err);
    let elsewhere = import(directory.path(), &[file, "--server", &server.url, "--key", &key, "--model", "nobody"]);
    assert!(elsewhere.err.contains("404"), "{}", elsewhere.err);
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
    let (said, why) = (stopped.out, stopped.err);
    assert!(!stopped.success);
    assert!(said.contains(" b1 ") && said.contains(" b2 ") && !said.contains("again.jsonl.gz"), "{said}");
    assert!(why.contains("again.jsonl.gz nor a file after it was imported") && why.contains("429"), "{why}");
    server.stop().await;
}
