//! Models that go from one server to another as a file.

use std::path::Path;

use headway::store::verify::verify;
use reqwest::Method;
use reqwest::header::{CONTENT_TYPE, IF_NONE_MATCH};
use serde_json::{Value, json};

use crate::artifact::download;
use crate::copies::{batch, begin, fork, go_on_alike, lines, sound, went_on};
use crate::lived::execute;
use crate::migrations::{as_of, schemas};
use crate::support::command::headway;
use crate::support::events::events;
use crate::support::server::{Answer, Server};

async fn archive(server: &Server, model: &str) -> Vec<u8> {
    download(server, &format!("/v1/models/{model}/archive")).await.1
}

async fn take_in(server: &Server, model: &str, archive: Vec<u8>) -> Answer {
    let request = server.request(Method::POST, &format!("/v1/models/{model}/archive"));
    server.send(request.header(CONTENT_TYPE, "application/vnd.sqlite3").body(archive)).await
}

#[tokio::test]
async fn a_model_that_moved_goes_on_as_it_would_have_whatever_the_method() {
    let (server, other) = (Server::start().await, Server::start().await);
    // Row ids are others there.
    begin(&other, "before", "naive", &json!({})).await;
    for (name, method, settings) in lines() {
        begin(&server, &name, method, &settings).await;
        let file = archive(&server, &name).await;
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("one.headway");
        std::fs::write(&path, &file).unwrap();
        assert_eq!(verify(&path, &|_| ()).await.unwrap().faults, []);
        let moved = format!("{name}-moved");
        let made = take_in(&other, &moved, file).await.expect(201);
        assert_eq!((&made["live"], &made["head"], &made["method"]), (&json!(2), &json!(2), &json!(method)));
        go_on_alike((&server, &name), (&other, &moved)).await;
    }
    for server in [server, other] {
        sound(server).await;
    }
}

#[tokio::test]
async fn an_archive_of_every_earlier_schema_goes_on_as_one_of_this_release_does() {
    let (server, other) = (Server::start().await, Server::start().await);
    begin(&server, "a", "ewc", &json!({})).await;
    let directory = tempfile::tempdir().unwrap();
    let newest = directory.path().join("newest.headway");
    std::fs::write(&newest, archive(&server, "a").await).unwrap();
    let expected = went_on(&server, "a").await;
    for schema in schemas() {
        let (old, _) = as_of(schema, &newest).await;
        let moved = format!("schema-{schema}");
        take_in(&other, &moved, std::fs::read(old.path().join("headway.db")).unwrap()).await.expect(201);
        assert_eq!(went_on(&other, &moved).await, expected, "schema {schema}");
    }
    for server in [server, other] {
        sound(server).await;
    }
}

#[tokio::test]
async fn an_archive_holds_all_of_one_model_and_nothing_of_another() {
    let server = Server::start().await;
    begin(&server, "a", "ewc", &json!({})).await;
    begin(&server, "b", "mas", &json!({})).await;
    // A retraction, a rollback, a rejection, a duplicate, something that waits: whatever a model can have.
    let mut mixed = vec![batch("fast", 16.0)[0].clone()];
    mixed.extend(events("waiting", 3, 9.0));
    mixed.push(
        json!({"event_id": "bad", "dt_s": 0.1, "spacing_m": [1], "follower_speed_mps": [], "leader_speed_mps": []}),
    );
    let uploaded = server.upload("a", "?regime=waiting&source=site", &mixed).await.expect(201);
    server.post("/v1/models/a/rollback", &json!({"version": 1, "reason": "tried"})).await.expect(200);
    server.learn("a", "slow", &batch("slow", 6.0)).await;
    server.post("/v1/models/a/pause", &json!({})).await.expect(200);
    let waits = json!({"batches": [uploaded["batch_id"]], "regime": "waiting"});
    server.post("/v1/models/a/tasks", &waits).await.expect(202);
    let batches = server.get("/v1/models/a/batches").await;
    let first = batches["batches"][0]["batch_id"].as_str().unwrap().to_owned();
    server.send(server.request(Method::DELETE, &format!("/v1/models/a/batches/{first}"))).await.expect(202);
    let (headers, file) = download(&server, "/v1/models/a/archive").await;
    assert_eq!(headers["content-disposition"], "attachment; filename=\"a.headway\"");
    assert_eq!(archive(&server, "a").await, file, "the same model is the same bytes");
    let known = server.request(Method::GET, "/v1/models/a/archive").header(IF_NONE_MATCH, &headers["etag"]);
    assert_eq!(known.send().await.unwrap().status(), 304);
    let noted = server.get("/v1/audit?model=a").await["audit"].as_array().unwrap().last().unwrap().clone();
    assert_eq!((&noted["action"], &noted["detail"]["bytes"]), (&json!("archive.take"), &json!(file.len())));
    let other = Server::start().await;
    take_in(&other, "a", file).await.expect(201);
    for (server, model) in [(&server, "a"), (&other, "a")] {
        server.post(&format!("/v1/models/{model}/resume"), &json!({})).await.expect(200);
        let tasks = server.get(&format!("/v1/models/{model}/tasks")).await["tasks"].as_array().unwrap().clone();
        for task in tasks {
            server.end_of(model, task["task_id"].as_str().unwrap()).await;
        }
    }
    let told = async |server: &Server| {
        let mut told = Vec::new();
        for plural in ["versions", "history", "sources"] {
            let page = server.get(&format!("/v1/models/a/{plural}")).await.expect(200);
            for mut entry in page[plural].as_array().unwrap().clone() {
                // What was done after the move is another moment's, and ids are others, also in what is said.
                for name in ["created_at", "at", "history_id", "task_id", "report", "promotion", "reason"] {
                    entry.as_object_mut().unwrap().remove(name);
                }
                told.push(entry);
            }
        }
        told
    };
    assert_eq!(told(&server).await, told(&other).await);
    let audit = other.get("/v1/audit?model=a").await["audit"].as_array().unwrap().clone();
    assert_eq!((&audit[0]["action"], &audit[0]["detail"]["from"]), (&json!("model.receive"), &json!("a")));
    for server in [server, other] {
        sound(server).await;
    }
}

#[tokio::test]
async fn an_archive_is_taken_in_once_and_under_a_name_that_is_free() {
    let server = Server::start().await;
    begin(&server, "a", "ewc", &json!({})).await;
    let file = archive(&server, "a").await;
    take_in(&server, "a", file.clone()).await.expect_problem(409, "model_exists");
    take_in(&server, "..", file.clone()).await.expect_problem(404, "not_found");
    let keyed = || {
        let request = server.request(Method::POST, "/v1/models/b/archive").header("idempotency-key", "a key");
        request.header(CONTENT_TYPE, "application/vnd.sqlite3").body(file.clone())
    };
    let made = server.send(keyed()).await.expect(201);
    assert_eq!(server.send(keyed()).await.expect(201).text, made.text);
    assert_eq!(made.header("location"), "/v1/models/b");
    let other = server.request(Method::POST, "/v1/models/c/archive").header(CONTENT_TYPE, "application/json");
    server.send(other.body("{}")).await.expect_problem(415, "unsupported_media_type");
    // What was taken in can be put into an archive again, and forked.
    take_in(&server, "c", archive(&server, "b").await).await.expect(201);
    fork(&server, "d", "ewc", "c", 1).await.expect(201);
    sound(server).await;
}

/// What somebody does to an archive.
const HOSTILE: &[(&str, &str)] = &[
    ("create trigger x after insert on model begin delete from model; end", "defines"),
    ("create view x as select * from model", "defines"),
    ("create table _sqlx_x (a)", "defines"),
    ("drop index event_waiting", "defines"),
    ("update _sqlx_migrations set version = 99 where version = 7", "schema 99"),
    ("delete from _sqlx_migrations where version = 7", "defines"),
    (
        "insert into model (name, method, settings, created_at) select 'b', method, settings, created_at from model",
        "one model",
    ),
    ("update event set arrays = zeroblob(length(arrays)) where event_id = 2", "events"),
    ("update weights set weights = zeroblob(length(weights))", "weights"),
    ("update model set head_version = 9", "head"),
    ("update model set settings = 'x', seal = null", "malformed model"),
    ("update model set settings = json_set(settings, '$.hidden', 1000000000), seal = null", "hidden"),
    ("update model set settings = json_set(settings, '$.hidden', 7), seal = null", "shape"),
    ("update model set name = '../x'", "name"),
    ("update version set scaling = '{}', seal = null", "scaling"),
    ("update batch set summary = '{'", "malformed summary"),
    ("update batch set created_at = 'today'", "malformed created_at"),
    ("update event set split = 'train', arrived_at = 'today' where event_id = 1", "arrived_at"),
    ("update reservoir set event_ids = zeroblob(16), seal = null", "reservoir"),
];

#[tokio::test]
async fn nothing_of_a_file_is_believed() {
    let server = Server::start().await;
    begin(&server, "a", "ewc", &json!({})).await;
    let file = archive(&server, "a").await;
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("hostile.db");
    let refused = async |bytes: Vec<u8>, why: &str| {
        let refused = take_in(&server, "b", bytes).await.expect_problem(422, "invalid_archive");
        assert!(refused["detail"].as_str().unwrap().contains(why), "{why}: {}", refused.text);
    };
    for (statement, why) in HOSTILE {
        std::fs::write(&path, &file).unwrap();
        execute(&path, statement).await;
        refused(std::fs::read(&path).unwrap(), why).await;
    }
    refused(Vec::new(), "").await;
    refused(b"no database at all".to_vec(), "").await;
    refused(file[..file.len() / 2].to_vec(), "").await;
    let mut flipped = file.clone();
    for at in (200..flipped.len()).step_by(997) {
        flipped[at] ^= 0x10;
    }
    refused(flipped, "").await;
    assert_eq!(server.get("/v1/models/b").await.status, 404);
    take_in(&server, "b", file).await.expect(201);
    sound(server).await;
}

#[tokio::test]
async fn what_is_corrupt_is_put_into_no_archive() {
    let server = Server::start().await;
    begin(&server, "a", "ewc", &json!({})).await;
    let database = server.directory.path().join("headway.db");
    execute(&database, "update event set arrays = zeroblob(length(arrays)) where event_id = 2").await;
    server.get("/v1/models/a/archive").await.expect_problem(409, "corrupt");
    execute(&database, "update version set stage = stage + 7 where version = 2").await;
    server.get("/v1/models/a/archive").await.expect_problem(409, "corrupt");
    server.stop().await;
}

fn command(arguments: &[&str]) -> (bool, Value, String) {
    let said = headway(&[arguments, &["--json"]].concat());
    (said.success, serde_json::from_str(&said.out).unwrap_or_default(), said.err)
}

#[tokio::test(flavor = "multi_thread")]
async fn the_command_moves_a_model_from_a_file_or_a_server_to_another() {
    let server = Server::start().await;
    begin(&server, "a", "ewc", &json!({})).await;
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let database = server.directory.path().join("headway.db").to_str().unwrap().to_owned();
    let (one, two, fresh) = (path("one.headway"), path("two.headway"), path("fresh.db"));
    // From beside a server that runs, and from the server.
    let (done, written, said) = command(&["archive", "--model", "a", "--to", &one, "--database", &database]);
    assert!(done && written["bytes"].as_u64().unwrap() > 0, "{said}");
    assert!(!command(&["archive", "--model", "a", "--to", &one, "--database", &database]).0, "it exists");
    assert!(!command(&["archive", "--model", "absent", "--to", &two, "--database", &database]).0);
    let (done, _, said) = command(&["archive", "--model", "a", "--to", &two, "--server", &server.url]);
    assert!(done, "{said}");
    assert_eq!(std::fs::read(&one).unwrap(), std::fs::read(&two).unwrap());
    // Into a server, and into a database of its own.
    let (done, made, said) = command(&["archive", "--model", "b", "--from", &one, "--server", &server.url]);
    assert!(done && made["live"] == 2, "{said}");
    let (done, _, said) = command(&["archive", "--model", "b", "--from", &one, "--server", &server.url]);
    assert!(!done && said.contains("already called b"), "{said}");
    let (done, made, said) = command(&["archive", "--model", "c", "--from", &two, "--database", &fresh]);
    assert!(done && made["head"] == 2, "{said}");
    assert_eq!(verify(Path::new(&fresh), &|_| ()).await.unwrap().faults, []);
    let (done, _, said) = command(&["archive", "--model", "c", "--from", &two, "--database", &database]);
    assert!(!done && said.contains("--server"), "{said}");
    sound(server).await;
}
