use futures_util::future::join_all;
use serde_json::{Value, json};

use crate::inference::{HORIZON, learned};
use crate::support::events::events;
use crate::support::server::{Answer, Server};

/// Step `t` of vehicle `n`: follower speed, leader speed, relative speed, spacing.
fn step(n: usize, t: usize) -> [f32; 4] {
    let (follower, leader) = (12.0 + n as f32 / 50.0, 13.0 + (t as f32 / 3.0).sin());
    [follower, leader, leader - follower, 20.0 + t as f32 / 4.0]
}

fn body(id: &Value, parameters: &[(&str, bool)], step: [f32; 4]) -> Value {
    let mut given: serde_json::Map<_, _> =
        parameters.iter().map(|&(name, value)| (name.to_owned(), json!(value))).collect();
    given.insert("sequence_id".to_owned(), id.clone());
    json!({"parameters": given, "inputs": [{"name": "step", "datatype": "FP32", "shape": [1, 4], "data": step}]})
}

async fn send(server: &Server, id: &Value, parameters: &[(&str, bool)], step: [f32; 4]) -> Answer {
    server.post("/v2/models/default/infer", &body(id, parameters, step)).await
}

/// What predict answers for the last steps up to `t`, the first standing for those before it.
async fn predicted(server: &Server, version: &str, n: usize, t: usize) -> Value {
    let rows: Vec<_> = (0..HORIZON).rev().map(|back| step(n, t.saturating_sub(back))).collect();
    let column = |at: usize| rows.iter().map(|row| row[at]).collect::<Vec<_>>();
    let window = json!({"follower_speed_mps": column(0), "leader_speed_mps": column(1), "spacing_m": column(3)});
    let wish = json!({"windows": [window], "version": version.parse::<i64>().unwrap()});
    let answer = server.post("/v1/models/default/predict", &wish).await.expect(200);
    json!([answer["predictions"][0]["accel_mps2"], answer["predictions"][0]["raw_accel_mps2"]])
}

fn told(answer: &Answer) -> Value {
    json!([answer["outputs"][0]["data"][0], answer["outputs"][1]["data"][0]])
}

#[tokio::test]
async fn a_vehicle_is_answered_by_the_version_that_it_began_with_unless_it_asks_for_what_serves() {
    let server = learned(1).await;
    let (pinned, follows) = (json!("bus-12"), json!(7));
    for id in [&pinned, &follows] {
        let first = send(&server, id, &[("sequence_start", true)], step(0, 0)).await.expect(200);
        assert_eq!((&first["model_version"], &first["parameters"]["warming_up"]), (&json!("1"), &json!(true)));
        assert_eq!(told(&first), predicted(&server, "1", 0, 0).await);
    }
    for t in 1..3 {
        // 7.0 is 7.
        for id in [&pinned, &json!(7.0)] {
            let next = send(&server, id, &[], step(0, t)).await.expect(200);
            assert_eq!(told(&next), predicted(&server, "1", 0, t).await);
        }
    }
    server.learn("default", "slow", &events("slow", 12, 6.0)).await;
    for t in 3..12 {
        let stays = send(&server, &pinned, &[], step(0, t)).await.expect(200);
        assert_eq!((&stays["model_version"], told(&stays)), (&json!("1"), predicted(&server, "1", 0, t).await));
        assert_eq!(stays["parameters"]["warming_up"].is_null(), t + 1 >= HORIZON, "step {t}");
        let goes = send(&server, &follows, &[("sequence_follow_live", true)], step(0, t)).await.expect(200);
        assert_eq!((&goes["model_version"], told(&goes)), (&json!("2"), predicted(&server, "2", 0, t).await));
        assert_eq!(goes["parameters"]["warming_up"].is_null(), t + 1 >= HORIZON, "step {t}");
    }
    // The path may name the version, as long as it is the same.
    let named = "/v2/models/default/versions/2/infer";
    let other = server.post(named, &body(&pinned, &[], step(0, 12))).await.expect(422);
    assert!(other["error"].as_str().unwrap().contains("stays with it"));
    let begun = server.post(named, &body(&pinned, &[("sequence_start", true)], step(0, 0))).await.expect(200);
    assert_eq!((&begun["model_version"], told(&begun)), (&json!("2"), predicted(&server, "2", 0, 0).await));
    server.stop().await;
}

#[tokio::test]
async fn a_sequence_begins_and_ends() {
    let server = learned(1).await;
    let id = json!(9);
    let unknown = send(&server, &id, &[], step(0, 0)).await.expect(422);
    assert!(unknown["error"].as_str().unwrap().contains("sequence_start begins one"));
    send(&server, &id, &[("sequence_start", true)], step(0, 0)).await.expect(200);
    let hollow = server.post("/v2/models/default/infer", &body(&id, &[], [1e7, 0.0, 0.0, 1.0])).await;
    hollow.expect(422);
    send(&server, &id, &[("sequence_end", true)], step(0, 1)).await.expect(200);
    send(&server, &id, &[], step(0, 2)).await.expect(422);
    // One step may be all of it; zero and an empty name are none.
    send(&server, &id, &[("sequence_start", true), ("sequence_end", true)], step(0, 0)).await.expect(200);
    send(&server, &id, &[], step(0, 1)).await.expect(422);
    for none in [json!(0), json!(0.0), json!(""), Value::Null] {
        let error = send(&server, &none, &[("sequence_start", true)], step(0, 0)).await.expect(422);
        assert!(error["error"].as_str().unwrap().contains("belongs to a sequence"));
    }
    send(&server, &json!("x".repeat(129)), &[("sequence_start", true)], step(0, 0)).await.expect(422);
    server.stop().await;
}

#[tokio::test]
async fn too_many_are_refused_and_idle_ones_make_room() {
    let server = Server::start_with("[predict]\nsequences = 2\nsequence_idle_s = 2.0").await;
    server.learn("default", "fast", &events("fast", 12, 14.0)).await;
    let start = async |id: u64| send(&server, &json!(id), &[("sequence_start", true)], step(0, 0)).await;
    start(1).await.expect(200);
    start(2).await.expect(200);
    let full = start(3).await;
    if full.status == 503 {
        assert_eq!(full.header("retry-after"), "1");
    }
    // Whoever is refused comes again, until the first two have been idle for long enough.
    let mut tries = 0;
    while start(3).await.status == 503 {
        tries += 1;
        assert!(tries < 1_000_000, "nobody is let go");
    }
    assert!(full.status == 503 && tries > 0, "the case is meant to show a refusal");
    send(&server, &json!(1), &[], step(0, 1)).await.expect(422);
    server.stop().await;
}

#[tokio::test]
async fn a_thousand_open_sequences_see_no_promotion_and_miss_no_answer() {
    const VEHICLES: usize = 1000;
    let server = learned(2).await;
    let one = async |n: usize, parameters: &[(&str, bool)], t: usize| {
        send(&server, &json!(n + 1), parameters, step(n, t)).await.expect(200)
    };
    let promote = async |version: u8| {
        let wish = json!({"version": version, "reason": "in mid-manoeuvre"});
        server.post("/v1/models/default/promote", &wish).await.expect(200);
    };
    // Half begin with either version.
    for half in 0..2_usize {
        promote(half as u8 + 1).await;
        let first =
            join_all((half * VEHICLES / 2..(half + 1) * VEHICLES / 2).map(|n| one(n, &[("sequence_start", true)], 0)));
        for answer in first.await {
            assert_eq!(answer["model_version"], (half + 1).to_string());
        }
    }
    for t in 1..4 {
        let steps = join_all((0..VEHICLES).map(|n| one(n, &[], t)));
        let moves = async {
            for turn in 0..10_u8 {
                promote(turn % 2 + 1).await;
            }
            server.post("/v1/models/default/rollback", &json!({"version": 1, "reason": "a turn"})).await.expect(200);
            promote(2).await;
        };
        let (answers, ()) = tokio::join!(steps, moves);
        for (n, answer) in answers.iter().enumerate() {
            let version = if n < VEHICLES / 2 { "1" } else { "2" };
            assert_eq!(answer["model_version"], version, "vehicle {n}, step {t}");
            if n % 50 == 0 {
                assert_eq!(told(answer), predicted(&server, version, n, t).await, "vehicle {n}, step {t}");
            }
        }
    }
    server.stop().await;
}
