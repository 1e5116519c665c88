use std::path::Path;
use std::process::{Command, Output};

use headway::store::verify::{Verification, verify};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::lived::{Lived, execute};
use crate::support::events::events;
use crate::support::server::Server;

async fn look(database: &Path) -> Verification {
    verify(database, &|_| ()).await.unwrap()
}

/// What somebody does to a database, and the check that finds it.
const TAMPERED: &[(&str, &str)] = &[
    ("drop index event_waiting", "definitions"),
    ("update event set arrays = zeroblob(length(arrays)) where event_id = 2", "events"),
    ("update event set steps = steps + 1 where event_id = 2", "events"),
    ("update weights set weights = zeroblob(length(weights)) where version = 1 and model_id = 1", "weights"),
    ("update anchor set importance = zeroblob(length(importance)) where anchor_id = 2", "anchors"),
    ("update model set settings = replace(settings, '0.004', '0.005')", "seals of models"),
    ("update version set scaling = replace(scaling, '1', '2') where version = 2", "seals of versions"),
    ("update version_regime set spacing_mse = 0 where version = 2", "seals of evaluations"),
    ("update reservoir set event_ids = zeroblob(16) where reservoir_id = 1", "seals of test reservoirs"),
    ("update version set events_sha256 = zeroblob(32) where version = 2 and model_id = 2", "fingerprints"),
    ("delete from task_event where task_id = 1 and event_id = 1", "fingerprints"),
    ("update event set split = 'test' where event_id = 1", "fingerprints"),
    ("delete from version where version = 1 and model_id = 1", "references"),
    ("update model set live_version = 9 where model_id = 1", "live and head"),
    ("update model set head_version = 9 where model_id = 1", "live and head"),
    ("update model set live_version = 2 where model_id = 1", "history"),
    ("update history set from_live = null", "history"),
    ("update version set parent = 2 where version = 2", "lineage"),
    ("update version set stage = 3 where version = 2", "lineage"),
    ("update task set state = 'cancelled' where task_id = 1", "lineage"),
    ("update task set version = 2 where task_id = 1", "lineage"),
    ("delete from weights where version = 1", "lineage"),
    ("update version_regime set learned_version = 1 where version = 2 and position = 1", "evaluations"),
    ("delete from version_regime where version = 2 and position = 1", "evaluations"),
    ("update anchor set model_id = 2", "evaluations"),
    ("update version_regime set anchor_id = null", "evaluations"),
    ("delete from task_event where task_id = 1", "tasks"),
    (
        "update task_event set event_id = (select max(event_id) from event where model_id = 2) where task_id = 1 and event_id = 1",
        "tasks",
    ),
    ("update checkpoint set task_id = 1", "tasks"),
    ("update checkpoint set state = x'01'", "checkpoints"),
    ("update task set state = 'running' where model_id = 1", "tasks"),
    ("update event set state = 'pending' where state = 'claimed'", "tasks"),
    ("update task set version = 3 - version where model_id = 1", "tasks"),
    ("update task set state = 'queued' where task_id = 1", "tasks"),
    ("update batch set accepted = accepted + 1 where batch_id = 1", "batches"),
    ("update batch set duplicates = duplicates - 1, accepted = accepted + 1 where batch_id = 3", "batches"),
    ("delete from rejection", "batches"),
    ("update event set batch_id = 2 where event_id = 1", "batches"),
    ("update event set state = 'claimed' where event_id = 1", "events' states"),
    ("update event set state = 'learned' where state = 'retracted'", "events' states"),
];

#[tokio::test]
async fn a_database_that_was_let_be_is_sound_and_every_fault_is_found_where_it_is() {
    let Lived { directory, .. } = Lived::until(i64::MAX).await;
    let database = directory.path().join("headway.db");
    let sound = look(&database).await;
    assert!(sound.is_sound(), "{:#?}", sound.faults);
    assert!(sound.checks.iter().all(|checked| checked.looked_at > 0), "{:#?}", sound.checks);
    for (statement, check) in TAMPERED {
        let copy = directory.path().join("copy.db");
        std::fs::copy(&database, &copy).unwrap();
        execute(&copy, statement).await;
        let found = look(&copy).await;
        assert!(!found.is_sound(), "{statement}");
        assert!(found.faults.iter().any(|fault| fault.check == *check), "{statement}: {:#?}", found.faults);
    }
    let checks: std::collections::BTreeSet<_> = TAMPERED.iter().map(|(_, check)| *check).collect();
    let untried: Vec<_> = sound.checks.iter().map(|c| c.check).filter(|check| !checks.contains(check)).collect();
    assert_eq!(untried, ["header", "pages"], "flipped bits are tried by themselves");
}

/// Flips a bit of the file.
fn flip(database: &Path, at: usize) {
    let mut bytes = std::fs::read(database).unwrap();
    bytes[at] ^= 1;
    std::fs::write(database, bytes).unwrap();
}

#[tokio::test]
async fn damaged_pages_and_headers_and_files_that_are_none_are_told_apart() {
    let Lived { directory, .. } = Lived::until(i64::MAX).await;
    let database = directory.path().join("headway.db");
    let (copy, size) = (directory.path().join("copy.db"), std::fs::metadata(&database).unwrap().len());
    for at in [0, 20, 100] {
        std::fs::copy(&database, &copy).unwrap();
        flip(&copy, at);
        let found = look(&copy).await;
        assert!(!found.is_sound(), "a bit of byte {at} was flipped");
    }
    std::fs::copy(&database, &copy).unwrap();
    std::fs::File::options().write(true).open(&copy).unwrap().set_len(size - 3 * 4096).unwrap();
    assert!(!look(&copy).await.is_sound(), "its end is gone");
    let told = |path: &'static str| {
        let path = directory.path().join(path);
        async move { verify(&path, &|_| ()).await.unwrap_err().to_string() }
    };
    assert!(told("nothing.db").await.contains("there is no"), "{}", told("nothing.db").await);
    execute(&copy_of(&directory, "empty.db"), "create table t (x)").await;
    assert!(told("empty.db").await.contains("no database of Headway"), "{}", told("empty.db").await);
    std::fs::copy(&database, directory.path().join("newer.db")).unwrap();
    let applied = "insert into _sqlx_migrations values (9999, 'later', '2027-01-01', 1, x'00', 0)";
    execute(&directory.path().join("newer.db"), applied).await;
    assert!(told("newer.db").await.contains("9999"), "{}", told("newer.db").await);
}

fn copy_of(directory: &TempDir, name: &str) -> std::path::PathBuf {
    let path = directory.path().join(name);
    std::fs::File::create(&path).unwrap();
    path
}

fn headway(arguments: &[&str], database: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    command.args(arguments).arg("--database").arg(database).output().unwrap()
}

#[tokio::test]
async fn the_command_succeeds_only_when_all_is_well_and_learns_versions_again() {
    let Lived { directory, .. } = Lived::until(i64::MAX).await;
    let database = directory.path().join("headway.db");
    let arguments = ["verify", "--json", "--retrain", "1", "--retrain", "default@2", "--retrain", "joint@2"];
    let output = headway(&arguments, &database);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(output.status.success(), "{report}");
    assert_eq!((&report["sound"], &report["faults_in_all"]), (&json!(true), &json!(0)));
    assert!(report["retrained"].as_array().unwrap().iter().all(|again| again["same"] == true), "{report}");
    assert_eq!(report["retrained"].as_array().unwrap().len(), 3);
    execute(&database, "update version set weights_sha256 = zeroblob(32) where version = 2 and model_id = 1").await;
    let output = headway(&arguments, &database);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(!output.status.success());
    let same: Vec<_> = report["retrained"].as_array().unwrap().iter().map(|again| again["same"].clone()).collect();
    assert_eq!(same, [true, false, true]);
    let table = String::from_utf8(headway(&["verify"], &database).stdout).unwrap();
    assert!(table.contains("weights: model default, version 2: the digest of its weights"), "{table}");
}

#[tokio::test]
async fn a_server_may_run_meanwhile() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    let found = look(&server.directory.path().join("headway.db")).await;
    assert!(found.is_sound(), "{:#?}", found.faults);
    server.learn("default", "slow", &events("f", 12, 6.0)).await;
    server.stop().await;
}
