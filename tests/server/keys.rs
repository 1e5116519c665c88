use std::time::{Duration, Instant};

use jiff::{SignedDuration, Timestamp};
use reqwest::Method;
use serde_json::{Value, json};

use crate::support::binary::Binary;
use crate::support::command::headway;
use crate::support::events::events;
use crate::support::server::{Answer, Server};

async fn revoke(server: &Server, key: &str, query: &str) -> Answer {
    server.send(server.request(Method::DELETE, &format!("/v1/keys/{}{query}", &key[3..19]))).await
}

#[tokio::test]
async fn a_key_is_shown_once_and_works_until_it_is_revoked() {
    let mut server = Server::start().await;
    server.post("/v1/keys", &json!({"scopes": ["predict"]})).await.expect_problem(409, "admin_key_first");
    server.close_gate().await;
    let wish = json!({"name": "van 7", "scopes": ["ingest", "predict"], "models": ["default"]});
    let made = server.post_with_key("/v1/keys", "k", &wish).await.expect(201);
    let key = made["key"].as_str().unwrap().to_owned();
    assert_eq!(made.header("location"), format!("/v1/keys/{}", &key[3..19]));
    // What is sent again is answered again, but for what is shown once.
    let again = server.post_with_key("/v1/keys", "k", &wish).await.expect(201);
    assert_eq!((&again["key"], &again["key_id"]), (&Value::Null, &made["key_id"]));
    let listed = server.get("/v1/keys").await.expect(200);
    assert_eq!(listed["keys"].as_array().unwrap().len(), 2);
    assert!(!listed.text.contains(&key[20..]));
    assert_eq!(server.get(made.header("location")).await.expect(200)["scopes"], json!(["predict", "ingest"]));
    let admin = server.key.replace(key.clone());
    server.get("/v1/models/default").await.expect(200);
    server.key = admin;
    for _ in 0..2 {
        let revoked = revoke(&server, &key, "").await.expect(200);
        assert_eq!(revoked["state"], "revoked");
    }
    server.key = Some(key);
    server.get("/v1/models/default").await.expect_problem(401, "key_revoked");
    server.stop().await;
}

#[tokio::test]
async fn a_key_stops_at_its_time_without_a_restart() {
    let mut server = Server::start().await;
    server.close_gate().await;
    let end = Timestamp::now() + SignedDuration::from_millis(300);
    let wish = json!({"scopes": ["train"], "expires_at": end.to_string()});
    server.key = Some(server.make_key(&wish).await);
    let patience = Instant::now() + Duration::from_mins(1);
    loop {
        let (before, answer) = (Timestamp::now(), server.get("/v1/models").await);
        if answer.status == 401 {
            assert!(Timestamp::now() >= end, "it stopped too early");
            answer.expect_problem(401, "key_expired");
            break;
        }
        assert!(before < end, "it opens something after its end: {}", answer.text);
        assert!(Instant::now() < patience);
    }
    server.stop().await;
}

#[tokio::test]
async fn the_server_stays_closed_when_every_key_has_ended() {
    let mut server = Server::start().await;
    server.close_gate().await;
    let admin = server.key.clone().unwrap();
    revoke(&server, &admin, "").await.expect_problem(409, "last_admin_key");
    server.get("/v1/keys").await.expect(200);
    revoke(&server, &admin, "?force=true").await.expect(200);
    server.get("/v1/models").await.expect_problem(401, "key_revoked");
    let mut server = server.restart().await;
    server.get("/v1/models").await.expect_problem(401, "key_revoked");
    server.key = None;
    server.get("/v1/models").await.expect_problem(401, "unauthenticated");
    let directory = server.stop().await;
    // Who has the database can make another.
    let database = directory.path().join("headway.db");
    let made = headway(&["keys", "create", "--scope", "admin", "--database", database.to_str().unwrap()]);
    let mut server = Server::start_in(directory, "").await;
    server.key = Some(made.out.trim().to_owned());
    server.get("/v1/models").await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn a_stream_is_closed_when_its_key_is_revoked() {
    let mut server = Server::start_with("[server]\nprogress_interval_s = 0.05").await;
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "", &events("e", 3, 9.0)).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    server.close_gate().await;
    let key = server.make_key(&json!({"scopes": ["train"]})).await;
    let url = format!("{}/v1/models/default/tasks/t1/progress", server.url);
    let mut stream = reqwest::Client::new().get(url).bearer_auth(&key).send().await.unwrap();
    assert!(stream.chunk().await.unwrap().is_some(), "the task as it stands");
    revoke(&server, &key, "").await.expect(200);
    while stream.chunk().await.unwrap().is_some() {}
    server.stop().await;
}

#[tokio::test]
async fn a_wish_for_a_key_that_cannot_be_is_refused_and_pointed_at() {
    let server = Server::start().await;
    for (wish, pointer) in [
        (json!({"scopes": []}), "/scopes"),
        (json!({"scopes": ["everything"]}), "/scopes/0"),
        (json!({"scopes": ["train"], "models": []}), "/models"),
        (json!({"scopes": ["train"], "models": ["a b"]}), "/models/0"),
        (json!({"scopes": ["admin"], "models": ["a"]}), "/models"),
        (json!({"scopes": ["admin"], "name": ""}), "/name"),
        (json!({"scopes": ["admin"], "expires_at": "2001-01-01T00:00:00Z"}), "/expires_at"),
        (json!({"scopes": ["admin"], "expires_at": "soon"}), "/expires_at"),
    ] {
        let answer = server.post("/v1/keys", &wish).await.expect_problem(422, "invalid_body");
        assert_eq!(answer["errors"][0]["pointer"], pointer, "{wish}");
    }
    for key_id in ["0123456789abcdef", "x", "0123456789ABCDEF"] {
        server.get(&format!("/v1/keys/{key_id}")).await.expect_problem(404, "key_not_found");
    }
    server.send(server.request(Method::DELETE, "/v1/keys/0123456789abcdef")).await.expect(404);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn keys_are_managed_from_the_command_line_in_a_file_and_at_a_server() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("headway.db");
    let database = database.to_str().unwrap();
    let absent = headway(&["keys", "list", "--database", database]);
    assert!(!absent.success && absent.err.contains("there is no database"));
    let first = headway(&["keys", "create", "--scope", "train", "--database", database]);
    assert!(first.success && first.err.contains("no admin key is active"), "{}", first.err);
    let made = headway(&["keys", "create", "--scope", "admin", "--name", "mine", "--database", database]);
    assert!(made.success, "{}", made.err);
    let admin = made.out.trim().to_owned();

    let mut server = Server::start_in(directory, "").await;
    server.get("/v1/models").await.expect(401);
    server.key = Some(admin.clone());
    server.get("/v1/models").await.expect(200);
    let owned = headway(&["keys", "list", "--database", database]);
    assert!(owned.err.contains("use --server URL"), "{}", owned.err);
    let at_server = |arguments: &[&str]| headway(&[arguments, &["--server", &server.url, "--key", &admin]].concat());
    let made =
        at_server(&["keys", "create", "--scope", "predict,ingest", "--model", "default", "--expires", "90d", "--json"]);
    let made: Value = made.json();
    assert_eq!((&made["scopes"], &made["models"]), (&json!(["predict", "ingest"]), &json!(["default"])));
    let key_id = made["key_id"].as_str().unwrap();
    let listed = at_server(&["keys", "list"]).done();
    assert!(listed.contains(key_id) && listed.contains("mine") && !listed.contains(&admin[20..]), "{listed}");
    assert!(at_server(&["keys", "revoke", key_id]).success);
    let last = at_server(&["keys", "revoke", &admin[3..19]]);
    assert!(!last.success && last.err.contains("last active admin key"), "{}", last.err);
    let listed: Value = at_server(&["keys", "list", "--json"]).json();
    let states: Vec<_> = listed["keys"].as_array().unwrap().iter().map(|key| &key["state"]).collect();
    assert_eq!(states, ["active", "active", "revoked"]);
    let stranger = headway(&["keys", "list", "--server", &server.url]);
    assert!(!stranger.success && stranger.err.contains("401"), "{}", stranger.err);
    server.stop().await;
}

#[test]
fn a_server_without_keys_does_not_listen_beyond_loopback() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("headway.db");
    let refused = headway(&["--listen", "0.0.0.0:0", "--database", database.to_str().unwrap()]);
    let why = &refused.err;
    assert!(!refused.success && refused.out.is_empty(), "{why}");
    assert!(why.contains("not loopback") && why.contains("headway keys create --scope admin"), "{why}");
    // The command that it names lets it start.
    assert!(headway(&["keys", "create", "--scope", "admin", "--database", database.to_str().unwrap()]).success);
    let binary = Binary::start(&["--listen", "0.0.0.0:0", "--database", database.to_str().unwrap()]);
    assert!(binary.url.starts_with("http://0.0.0.0:"), "{}", binary.url);
}

#[tokio::test]
async fn a_key_in_a_file_is_known_from_the_start_and_stays_revoked() {
    let directory = tempfile::tempdir().unwrap();
    let (path, key) = (directory.path().join("key"), format!("hw_00112233445566ff_{}", "k".repeat(43)));
    std::fs::write(&path, format!("{key}\n")).unwrap();
    let settings = format!("[access]\nkey_file = {:?}", path.to_str().unwrap());
    let mut server = Server::start_in(directory, &settings).await;
    server.get("/v1/models").await.expect(401);
    server.key = Some(key.clone());
    server.get("/v1/models").await.expect(200);
    let server = server.restart().await;
    assert_eq!(server.get("/v1/keys").await["keys"][0]["name"], "access.key_file");
    revoke(&server, &key, "?force=true").await.expect(200);
    let server = server.restart().await;
    server.get("/v1/models").await.expect_problem(401, "key_revoked");
    server.stop().await;
}
