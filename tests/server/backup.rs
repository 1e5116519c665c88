use std::path::Path;
use std::process::{Command, Output};

use headway::store::verify::verify;
use serde_json::{Value, json};

use crate::lived::execute;
use crate::support::events::{events, window};
use crate::support::server::Server;

fn headway(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_headway")).args(arguments).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

async fn predict(server: &Server) -> Value {
    server.post("/v1/models/default/predict", &json!({"windows": [window(5, 9.0)]})).await.expect(200).body
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_backup_is_taken_from_a_running_server_and_restored_into_its_place() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    let before = predict(&server).await;
    let (database, to) = (server.directory.path().join("headway.db"), server.directory.path().join("kept.db"));
    let taken = headway(&["backup", "--database", text(&database), "--to", text(&to), "--json"]);
    assert!(taken.status.success(), "{}", String::from_utf8_lossy(&taken.stderr));
    let again = headway(&["backup", "--database", text(&database), "--to", text(&to)]);
    assert!(!again.status.success() && String::from_utf8_lossy(&again.stderr).contains("--force"));
    assert!(headway(&["backup", "--database", text(&database), "--to", text(&to), "--force"]).status.success());
    server.learn("default", "slow", &events("f", 12, 6.0)).await;
    assert_ne!(predict(&server).await, before);
    let restore = ["restore", "--from", text(&to), "--database", text(&database), "--json"];
    let owned = headway(&restore);
    assert!(!owned.status.success(), "a server owns it");
    let directory = server.stop().await;
    let restored = headway(&restore);
    assert!(restored.status.success(), "{}", String::from_utf8_lossy(&restored.stderr));
    let report: Value = serde_json::from_slice(&restored.stdout).unwrap();
    let aside = verify(Path::new(report["kept"].as_str().unwrap()), &|_| ()).await.unwrap();
    assert!(aside.is_sound(), "what was there is kept: {:#?}", aside.faults);
    let server = Server::start_in(directory, "").await;
    assert_eq!(predict(&server).await, before);
    server.stop().await;
}

#[tokio::test]
async fn what_is_not_sound_is_neither_backed_up_nor_restored() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    let directory = server.stop().await;
    let (database, good) = (directory.path().join("headway.db"), directory.path().join("good.db"));
    let (bad, to) = (directory.path().join("bad.db"), directory.path().join("to.db"));
    std::fs::copy(&database, &good).unwrap();
    std::fs::copy(&database, &bad).unwrap();
    execute(&bad, "update weights set weights = x'00'").await;
    let refused = headway(&["backup", "--database", text(&bad), "--to", text(&to)]);
    let told = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && told.contains("weights"), "{told}");
    let refused = headway(&["restore", "--from", text(&bad), "--database", text(&database)]);
    assert!(!refused.status.success());
    assert!(verify(&database, &|_| ()).await.unwrap().is_sound(), "it is as it was");
    let left: Vec<_> = std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!left.iter().any(|name| name.to_str().unwrap().contains("partial")), "{left:?}");
    assert!(!to.exists());
    // A database that is beyond reading can be replaced all the same.
    std::fs::write(&database, b"no database at all, but of some length").unwrap();
    assert!(headway(&["restore", "--from", text(&good), "--database", text(&database)]).status.success());
    assert!(verify(&database, &|_| ()).await.unwrap().is_sound());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_writes_backups_into_its_own_folder_and_keeps_the_newest() {
    let folder = tempfile::tempdir().unwrap();
    let settings = format!("[backup]\nfolder = \"{}\"\nkeep = 2", text(folder.path()));
    let mut server = Server::start_with(&settings).await;
    server.learn("default", "fast", &events("e", 12, 16.0)).await;
    server.close_gate().await;
    let key = server.key.clone().unwrap();
    std::fs::write(folder.path().join("headway-notes.db"), "somebody else's").unwrap();
    let mut taken = Vec::new();
    for _ in 0..2 {
        taken.push(server.post("/v1/backup", &json!({})).await.expect(201).body);
    }
    let by_command = headway(&["backup", "--server", &server.url, "--key", &key, "--json"]);
    assert!(by_command.status.success(), "{}", String::from_utf8_lossy(&by_command.stderr));
    taken.push(serde_json::from_slice(&by_command.stdout).unwrap());
    let listed = server.get("/v1/backup").await.expect(200);
    assert_eq!(listed["backups"], json!([taken[2], taken[1]]), "newest first, the oldest is gone");
    assert!(folder.path().join("headway-notes.db").exists());
    let newest = folder.path().join(taken[2]["name"].as_str().unwrap());
    assert!(verify(&newest, &|_| ()).await.unwrap().is_sound());
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_backup_that_is_asked_for_again_is_the_same_one_and_the_audit_log_says_who_asked() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = Server::start_with(&format!("[backup]\nfolder = \"{}\"\nkeep = 2", text(folder.path()))).await;
    server.close_gate().await;
    let first = server.post_with_key("/v1/backup", "nightly", &json!({})).await.expect(201);
    for _ in 0..2 {
        let again = server.post_with_key("/v1/backup", "nightly", &json!({})).await.expect(201);
        assert_eq!((again.text.as_str(), again.header("idempotency-replayed")), (first.text.as_str(), "true"));
    }
    assert_eq!(server.get("/v1/backup").await["backups"], json!([first.body]));
    let other = server.post_with_key("/v1/backup", "next", &json!({})).await.expect(201);
    assert_eq!(server.get("/v1/backup").await["backups"], json!([other.body, first.body]));
    let log = server.get("/v1/audit").await.expect(200);
    let taken = log["audit"].as_array().unwrap().iter().filter(|entry| entry["action"] == "backup.take");
    let admin = &server.key.as_deref().unwrap()[3..19];
    let told: Vec<_> = taken.map(|it| ["actor", "resource"].map(|name| it[name].as_str().unwrap())).collect();
    assert_eq!(told, [&first, &other].map(|taken| [admin, taken["name"].as_str().unwrap()]));
    // The copy itself was made before anything was said about it.
    let copied = folder.path().join(first["name"].as_str().unwrap());
    assert!(verify(&copied, &|_| ()).await.unwrap().is_sound());
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn without_a_folder_a_server_takes_none() {
    let server = Server::start().await;
    server.post("/v1/backup", &json!({})).await.expect_problem(409, "no_backup_folder");
    assert_eq!(server.get("/v1/backup").await.expect(200)["backups"], json!([]));
    let refused = headway(&["backup", "--server", &server.url]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("keeps no backups"));
    server.stop().await;
}
