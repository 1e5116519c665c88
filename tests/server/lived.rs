//! Databases of servers that have done everything once.

use std::path::{Path, PathBuf};

use reqwest::Method;
use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, query};
use tempfile::TempDir;

use crate::support::events::events;
use crate::support::server::Server;

/// The task that waits; its model, `default`, is paused.
pub(crate) const WAITING: &str = "t5";

/// The schemas since which there are keys, replays of what was retracted, and retention.
const KEYS: i64 = 4;
const REPLAYS: i64 = 5;
const RETENTION: i64 = 6;

/// What a server left behind.
pub(crate) struct Lived {
    pub(crate) directory: TempDir,
    /// What it asks for, if it does.
    pub(crate) key: Option<String>,
}

impl Lived {
    /// A database with rows in every table that a schema has, of what that schema knew.
    pub(crate) async fn until(schema: i64) -> Self {
        let server = Server::start().await;
        learn(&server).await;
        let directory = server.stop().await;
        // One that fits nothing: the task will start afresh.
        let checkpoint = "insert into checkpoint select task_id, created_at, 0.5, x'00',
            x'6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d' from task where state = 'queued'";
        execute(&directory.path().join("headway.db"), checkpoint).await;
        let mut server = Server::start_in(directory, "").await;
        if schema >= REPLAYS {
            retract(&server).await;
        }
        if schema >= RETENTION {
            keep_little(&server).await;
        }
        if schema >= KEYS {
            server.close_gate().await;
        }
        Self { key: server.key.clone(), directory: server.stop().await }
    }

    pub(crate) fn database(&self) -> PathBuf {
        self.directory.path().join("headway.db")
    }

    /// A server on it.
    pub(crate) async fn start(self, settings: &str) -> Server {
        let Self { directory, key } = self;
        let mut server = Server::start_in(directory, settings).await;
        server.key = key;
        server
    }
}

/// Learns with two methods, moves the live version, refuses an event, and leaves a task that waits.
async fn learn(server: &Server) {
    let bad =
        json!({"event_id": "bad", "dt_s": 0.1, "spacing_m": [1], "follower_speed_mps": [], "leader_speed_mps": []});
    let mut mixed = events("e", 12, 16.0);
    mixed.push(bad);
    server.upload("default", "?regime=fast", &mixed).await.expect(201);
    let task = server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    server.end_of("default", task["task_id"].as_str().unwrap()).await;
    server.learn("default", "slow", &events("f", 12, 6.0)).await;
    server.upload("default", "?regime=slow", &events("f", 6, 6.0)).await.expect(201);
    server.post("/v1/models", &json!({"model": "joint", "method": "joint"})).await.expect(201);
    server.learn("joint", "fast", &events("e", 12, 16.0)).await;
    server.learn("joint", "slow", &events("f", 12, 6.0)).await;
    server.post("/v1/models/default/promote", &json!({"version": 1, "reason": "a test"})).await.expect(200);
    server.upload("default", "?regime=jam", &events("g", 4, 2.0)).await.expect(201);
    server.send(server.request(Method::DELETE, "/v1/models/default/batches/b6")).await.expect(200);
    let note = server.request(Method::PATCH, "/v1/models/default/versions/1").json(&json!({"note": "a note"}));
    server.send(note).await.expect(200);
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "?regime=rain", &events("h", 12, 9.0)).await.expect(201);
    let wish = json!({"batches": "pending"});
    let task = server.post_with_key("/v1/models/default/tasks", "a key", &wish).await.expect(202);
    assert_eq!(task["task_id"], WAITING);
}

/// Takes back the first of two batches that a model learned, and waits for the replay of the second.
async fn retract(server: &Server) {
    server.post("/v1/models", &json!({"model": "taken", "method": "joint"})).await.expect(201);
    server.learn("taken", "fast", &events("e", 12, 16.0)).await;
    server.learn("taken", "slow", &events("f", 12, 6.0)).await;
    let batch = server.get("/v1/models/taken/batches").await["batches"][0]["batch_id"].as_str().unwrap().to_owned();
    let retracted = server.request(Method::DELETE, &format!("/v1/models/taken/batches/{batch}"));
    let replay = server.send(retracted).await.expect(202);
    let ended = server.end_of("taken", replay["task_id"].as_str().unwrap()).await;
    assert_eq!(ended["state"], "succeeded", "{}", ended.text);
}

/// Learns from a source what is soon not kept, and has a batch erased.
async fn keep_little(server: &Server) {
    let settings = json!({"retention": {"events_s": 0, "versions": 1}});
    let body = json!({"model": "kept", "method": "ewc", "settings": settings});
    server.post("/v1/models", &body).await.expect(201);
    for (regime, speed) in [("fast", 16.0), ("middle", 11.0), ("slow", 6.0)] {
        server.upload("kept", "?source=site", &events("s", 2, speed)).await.expect(201);
        server.learn("kept", regime, &events(regime, 12, speed)).await;
    }
    let batches = server.get("/v1/models/kept/batches").await.expect(200);
    let first = format!("/v1/models/kept/batches/{}", batches["batches"][1]["batch_id"].as_str().unwrap());
    let pruned = async || {
        let version = server.get("/v1/models/kept/versions/1").await.expect(200);
        version["pruned"] == true && server.get(&first).await.expect(200)["pruned_events"] == 9
    };
    while !pruned().await {}
    let batches = server.get("/v1/models/taken/batches").await.expect(200);
    let path = format!("/v1/models/taken/batches/{}", batches["batches"][0]["batch_id"].as_str().unwrap());
    server.send(server.request(Method::DELETE, &format!("{path}?erase=true"))).await.expect(200);
    while server.get(&path).await.expect(200)["erased_at"].is_null() {}
}

/// Does something to a database that no server does.
pub(crate) async fn execute(database: &Path, statement: &'static str) {
    // A tamperer follows no references.
    let options = SqliteConnectOptions::new().filename(database).foreign_keys(false);
    let mut connection = options.connect().await.unwrap();
    query(statement).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
}
