use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};

use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use crate::support::events::{events, window};
use crate::support::server::Server;

#[tokio::test]
async fn what_was_answered_is_there_after_a_restart() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 12, 12.0)).await;
    let ask = json!({"windows": [window(5, 11.0)]});
    let paths = [
        "/v1/models",
        "/v1/models/default/batches",
        "/v1/models/default/tasks",
        "/v1/models/default/versions",
        "/v1/models/default/history",
    ];
    let mut before = Vec::new();
    for path in paths {
        before.push(server.get(path).await.expect(200).text);
    }
    let predicted = server.post("/v1/models/default/predict", &ask).await.expect(200).text;
    let server = server.restart().await;
    for (path, before) in paths.iter().zip(before) {
        assert_eq!(server.get(path).await.expect(200).text, before, "{path}");
    }
    server.get("/readyz").await.expect(200);
    assert_eq!(server.post("/v1/models/default/predict", &ask).await.expect(200).text, predicted);
    server.stop().await;
}

#[tokio::test]
async fn a_stopped_task_goes_on_after_the_restart_and_ends_with_the_same_bits() {
    let settings = "[model]\nepochs = 60";
    let through = Server::start_with(settings).await;
    through.learn("default", "fast", &events("e", 16, 12.0)).await;
    let expected = through.get("/v1/models/default/versions/1").await["weights_sha256"].clone();
    through.stop().await;

    let server = Server::start_with(settings).await;
    server.upload("default", "?regime=fast", &events("e", 16, 12.0)).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    let task = "/v1/models/default/tasks/t1";
    while server.get(task).await["progress"] == json!(0.0) {
        tokio::task::yield_now().await;
    }
    let server = server.restart().await;
    let ended = server.end_of("default", "t1").await;
    assert_eq!(ended["state"], "succeeded", "{}", ended.text);
    assert_eq!(server.get("/v1/models/default/versions/1").await["weights_sha256"], expected);
    server.stop().await;
}

#[tokio::test]
async fn waiting_ends_when_the_server_stops() {
    let mut server = Server::start().await;
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "", &events("e", 8, 12.0)).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    let waiting = server.request(reqwest::Method::GET, "/v1/models/default/tasks/t1?wait_s=60");
    let waiting = tokio::spawn(async move { waiting.send().await.unwrap().status() });
    // Answered after the waiter was accepted: requests of one client are served in the order they connect.
    server.get("/healthz").await.expect(200);
    server.tell_to_stop();
    assert_eq!(waiting.await.unwrap(), 200);
    server.stop().await;
}

#[tokio::test]
async fn connections_that_ask_nothing_do_not_keep_the_server() {
    let server = Server::start_with("[server]\ndrain_s = 3600").await;
    let address = server.url.trim_start_matches("http://").to_owned();
    let mut silent = tokio::net::TcpStream::connect(&address).await.unwrap();
    let mut idle = tokio::net::TcpStream::connect(&address).await.unwrap();
    idle.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\n\r\n").await.unwrap();
    assert!(idle.read_u8().await.is_ok(), "answered, so that it now waits between two requests");
    server.stop().await;
    let mut rest = Vec::new();
    assert_eq!(silent.read_to_end(&mut rest).await.unwrap(), 0);
    idle.read_to_end(&mut rest).await.unwrap();
    assert!(tokio::net::TcpStream::connect(&address).await.is_err());
}

#[tokio::test]
async fn one_process_owns_a_database() {
    let server = Server::start().await;
    let path = server.directory.path().join("headway.db");
    let output = Command::new(env!("CARGO_BIN_EXE_headway"))
        .args(["serve", "--listen", "127.0.0.1:0", "--database"])
        .arg(path)
        .output()
        .unwrap();
    assert!(!output.status.success() && output.stdout.is_empty());
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains("another running headway"), "{message}");
    server.stop().await;
}

#[test]
fn the_binary_says_where_it_listens_and_ends_well_on_sigterm() {
    let directory = tempfile::tempdir().unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_headway"))
        .args(["--listen", "127.0.0.1:0", "--database"])
        .arg(directory.path().join("headway.db"))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let mut first = String::new();
    stdout.read_line(&mut first).unwrap();
    assert!(first.starts_with("listening on http://127.0.0.1:"), "{first}");
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    assert!(child.wait().unwrap().success());
    let mut rest = String::new();
    stdout.read_to_string(&mut rest).unwrap();
    assert_eq!(rest, "");
}

#[test]
fn the_command_line_explains_and_refuses() {
    let run = |arguments: &[&str]| Command::new(env!("CARGO_BIN_EXE_headway")).args(arguments).output().unwrap();
    assert!(run(&["--help"]).status.success() && run(&["serve", "--help"]).status.success());
    let manual = run(&["--print-settings"]);
    assert_eq!(String::from_utf8(manual.stdout).unwrap(), headway::config::DEFAULTS);
    for (arguments, why) in [
        (vec!["--set", "server.colour=red"], "there is no setting server.colour"),
        (vec!["--config", "absent.toml"], "absent.toml"),
    ] {
        let refused = run(&arguments);
        let message = String::from_utf8(refused.stderr).unwrap();
        assert!(!refused.status.success() && message.contains(why), "{arguments:?}: {message}");
    }
}
