use std::path::Path;

use reqwest::Method;
use serde_json::{Value, json};

use crate::support::events::events;
use crate::support::server::{Answer, Server};

const BATCHES: &str = "/v1/models/default/batches";

/// How often some bytes stand in the database and its write-ahead log.
fn found(directory: &Path, bytes: &[u8]) -> usize {
    let count = |name: &str| {
        let file = std::fs::read(directory.join(name)).unwrap_or_default();
        file.windows(bytes.len()).filter(|part| *part == bytes).count()
    };
    count("headway.db") + count("headway.db-wal")
}

/// Some steps of an event, as they are stored.
fn stored(event: &Value, member: &str) -> Vec<u8> {
    let values = event[member].as_array().unwrap()[20..24].iter();
    #[expect(clippy::cast_possible_truncation, reason = "as they are stored")]
    let stored = values.flat_map(|value| (value.as_f64().unwrap() as f32).to_le_bytes());
    stored.collect()
}

async fn erased(server: &Server, batch: &str) -> Answer {
    loop {
        let read = server.get(&format!("{BATCHES}/{batch}")).await.expect(200);
        if !read["erased_at"].is_null() {
            return read;
        }
    }
}

#[tokio::test]
async fn what_is_erased_is_in_no_file_any_more_and_lineage_and_measures_stay() {
    let server = Server::start().await;
    let secret = events("confidential", 24, 16.0);
    let mut uploaded = secret.clone();
    uploaded.push(json!({"event_id": "confidential-bad", "dt_s": 0.1, "spacing_m": [1], "follower_speed_mps": [],
        "leader_speed_mps": []}));
    let (path, body) = (format!("{BATCHES}?regime=fast"), json!({"events": uploaded}));
    let upload = || server.post_with_key(&path, "k", &body);
    let first = upload().await.expect(201);
    assert_eq!(first["rejected"][0]["event_id"], "confidential-bad");
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    server.end_of("default", "t1").await;
    server.learn("default", "slow", &events("kept", 24, 6.0)).await;
    let directory = server.directory.path().to_owned();
    let parts: Vec<_> =
        secret.iter().flat_map(|it| ["spacing_m", "leader_speed_mps"].map(|of| stored(it, of))).collect();
    assert!(parts.iter().all(|part| found(&directory, part) > 0), "the test looks for what is there");
    let version = server.get("/v1/models/default/versions/1").await.body;
    let evaluation = server.get("/v1/models/default/versions/1/evaluation").await.body;

    let delete = server.request(Method::DELETE, &format!("{BATCHES}/b1?erase=true"));
    let replay = server.send(delete).await.expect(202);
    server.end_of("default", replay["task_id"].as_str().unwrap()).await;
    let read = erased(&server, "b1").await;
    assert_eq!((&read["events"]["retracted"], &read["rejected_count"]), (&json!(24), &json!(1)));
    let left: usize = parts.iter().map(|part| found(&directory, part)).sum();
    assert_eq!((left, found(&directory, b"confidential")), (0, 0));
    assert!(found(&directory, b"kept-1") > 0);

    let tainted = json!({"tainted": true});
    let after = server.get("/v1/models/default/versions/1").await.body;
    assert_eq!(after["weights_sha256"], version["weights_sha256"]);
    assert_eq!((&after["events_sha256"], &after["tainted"]), (&version["events_sha256"], &tainted["tainted"]));
    assert_eq!(server.get("/v1/models/default/versions/1/evaluation").await.body, evaluation);
    let rejections = server.get(&format!("{BATCHES}/b1/rejections")).await.expect(200);
    assert_eq!(
        (&rejections["rejections"][0]["event_id"], &rejections["rejections"][0]["detail"]),
        (&json!(null), &json!("erased"))
    );
    let again = upload().await.expect(201);
    assert_eq!(
        (&again["batch_id"], &again["rejected"]),
        (&json!("b1"), &json!([])),
        "the answer is given again, not the effect"
    );
    server.stop().await;
}

#[tokio::test]
async fn erased_content_may_come_anew_and_is_learned_as_before() {
    let server = Server::start().await;
    let uploaded = events("confidential", 16, 16.0);
    server.learn("default", "fast", &uploaded).await;
    let weights = server.get("/v1/models/default/versions/1").await["weights_sha256"].clone();
    let replay = server.send(server.request(Method::DELETE, &format!("{BATCHES}/b1"))).await.expect(202);
    server.end_of("default", replay["task_id"].as_str().unwrap()).await;
    let asked = server.send(server.request(Method::DELETE, &format!("{BATCHES}/b1?erase=true"))).await.expect(200);
    assert!(asked["erase_asked_at"].is_string(), "after the retraction as well");
    erased(&server, "b1").await;
    assert_eq!(server.learn("default", "fast", &uploaded).await, 2);
    assert_eq!(server.get("/v1/models/default/versions/2").await["weights_sha256"], weights);
    server.stop().await;
}

#[tokio::test]
async fn unused_pages_are_given_back_while_nothing_is_learned() {
    let server = Server::start().await;
    server.upload("default", "", &events("e", 2000, 16.0)).await.expect(201);
    server.send(server.request(Method::DELETE, &format!("{BATCHES}/b1?erase=true"))).await.expect(200);
    erased(&server, "b1").await;
    let unused = async || {
        let metrics = server.get("/metrics").await.expect(200).text;
        let value = |name: &str| {
            let line = metrics.lines().find(|line| line.starts_with(&format!("{name} "))).unwrap();
            line.split(' ').nth(1).unwrap().parse::<f64>().unwrap()
        };
        assert!(value("headway_database_bytes") > 0.0 && value("headway_database_wal_bytes") >= 0.0);
        value("headway_database_unused_bytes")
    };
    while unused().await > 0.0 {}
    server.stop().await;
}
