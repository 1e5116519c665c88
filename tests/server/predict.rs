use serde_json::{Value, json};

use crate::support::events::{events, window};
use crate::support::server::Server;

const PREDICT: &str = "/v1/models/default/predict";
const SIMULATE: &str = "/v1/models/default/simulate";

async fn trained(settings: &str) -> Server {
    let server = Server::start_with(settings).await;
    server.learn("default", "fast", &events("e", 12, 10.0)).await;
    server
}

#[tokio::test]
async fn a_window_gets_the_same_answer_alone_and_in_company() {
    let server = trained("[predict]\ninline_windows = 3").await;
    let windows: Vec<Value> = (0..40).map(|i| window(5, 8.0 + f64::from(i) * 0.1)).collect();
    let all = server.post(PREDICT, &json!({"windows": windows})).await.expect(200);
    assert_eq!((&all["model"], &all["version"]), (&json!("default"), &json!(1)));
    let predictions = all["predictions"].as_array().unwrap();
    assert_eq!(predictions.len(), 40);
    for at in [0, 7, 39] {
        let alone = server.post(PREDICT, &json!({"windows": [windows[at]], "version": 1})).await.expect(200);
        assert_eq!(alone["predictions"][0], predictions[at]);
    }
    assert!(predictions.iter().any(|one| one["accel_mps2"] != predictions[0]["accel_mps2"]));
    assert!(predictions.iter().all(|one| one["accel_mps2"] == one["raw_accel_mps2"]));
    server.stop().await;
}

#[tokio::test]
async fn what_training_never_saw_is_flagged() {
    let server = trained("").await;
    let strange = server.post(PREDICT, &json!({"windows": [window(5, 60.0)]})).await.expect(200);
    assert_eq!(strange["predictions"][0]["flags"], json!(["out_of_range"]));
    let usual = events("e", 1, 10.0).remove(0);
    let cut = |member: &str| usual[member].as_array().unwrap()[10..15].to_vec();
    let usual = json!({
        "follower_speed_mps": cut("follower_speed_mps"),
        "leader_speed_mps": cut("leader_speed_mps"),
        "spacing_m": cut("spacing_m"),
    });
    let usual = server.post(PREDICT, &json!({"windows": [usual]})).await.expect(200);
    assert_eq!(usual["predictions"][0]["flags"], json!([]));
    server.stop().await;
}

#[tokio::test]
async fn every_bad_window_is_pointed_at() {
    let server = trained("[server]\npredict_windows_max = 5\nsimulate_steps_max = 5").await;
    let mut bad = window(5, 10.0);
    bad["spacing_m"][2] = json!(1e39);
    let answer = server.post(PREDICT, &json!({"windows": [window(4, 10.0), window(5, 10.0), bad]})).await;
    let answer = answer.expect_problem(422, "invalid_body");
    let pointers: Vec<_> = answer["errors"].as_array().unwrap().iter().map(|e| e["pointer"].clone()).collect();
    assert_eq!(
        pointers,
        [
            "/windows/0/follower_speed_mps",
            "/windows/0/leader_speed_mps",
            "/windows/0/spacing_m",
            "/windows/2/spacing_m/2"
        ]
    );
    for body in [
        json!({"windows": []}),
        json!({"windows": vec![window(5, 10.0); 6]}),
        json!({"windows": [{"spacing_m": [1]}]}),
        json!({"windows": [window(5, 10.0)], "horizon": 5}),
    ] {
        server.post(PREDICT, &body).await.expect_problem(422, "invalid_body");
    }
    let nulls = json!({"windows": [{"follower_speed_mps": [null], "leader_speed_mps": [1], "spacing_m": [1]}]});
    let answer = server.post(PREDICT, &nulls).await.expect_problem(422, "invalid_body");
    assert_eq!(answer["errors"][0]["pointer"], "/windows/0/follower_speed_mps/0");
    let unknown = json!({"windows": [window(5, 10.0)], "version": 9});
    server.post(PREDICT, &unknown).await.expect_problem(404, "version_not_found");
    let short = server.post(SIMULATE, &json!({"initial": window(4, 10.0), "leader_speed_mps": [10.0]})).await;
    assert_eq!(short.expect_problem(422, "invalid_body")["errors"][0]["pointer"], "/initial/follower_speed_mps");
    for leader in [vec![], vec![10.0; 6]] {
        let body = json!({"initial": window(5, 10.0), "leader_speed_mps": leader});
        let answer = server.post(SIMULATE, &body).await.expect_problem(422, "invalid_body");
        assert_eq!(answer["errors"][0]["pointer"], "/leader_speed_mps");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_simulation_starts_where_a_prediction_points() {
    let server = trained("").await;
    let start = window(5, 10.0);
    let predicted = server.post(PREDICT, &json!({"windows": [start]})).await.expect(200);
    let driven =
        server.post(SIMULATE, &json!({"initial": start, "leader_speed_mps": vec![10.0; 30]})).await.expect(200);
    for member in ["spacing_m", "follower_speed_mps", "accel_mps2"] {
        assert_eq!(driven[member].as_array().unwrap().len(), 30, "{member}");
    }
    assert_eq!(driven["accel_mps2"][0], predicted["predictions"][0]["accel_mps2"]);
    assert_eq!(driven["collided"], false);
    server.stop().await;
}

/// A window behind a leader that stands `spacing` metres ahead.
fn towards_a_standing_leader(speed: f64, spacing: f64) -> Value {
    json!({
        "follower_speed_mps": vec![speed; 5],
        "leader_speed_mps": vec![0.0; 5],
        "spacing_m": (0..5).map(|t| spacing + 0.1 * speed * f64::from(4 - t)).collect::<Vec<_>>(),
    })
}

#[tokio::test]
async fn what_is_served_stops_behind_a_standing_leader_whatever_the_network_says() {
    let server = trained("").await;
    // 10 m/s and 8 m/s² need 6.25 m, a step more costs 1 m, and the network hardly brakes.
    let start = towards_a_standing_leader(10.0, 7.0);
    let predicted = server.post(PREDICT, &json!({"windows": [start]})).await.expect(200);
    let one = &predicted["predictions"][0];
    assert!(one["accel_mps2"].as_f64().unwrap() < one["raw_accel_mps2"].as_f64().unwrap());
    assert!(one["flags"].as_array().unwrap().contains(&json!("envelope")));
    let drive = json!({"initial": start, "leader_speed_mps": vec![0.0; 60]});
    let driven = server.post(SIMULATE, &drive).await.expect(200);
    assert_eq!(driven["collided"], false);
    assert!(driven["flags"].as_array().unwrap().contains(&json!("envelope")));
    let speeds: Vec<_> = driven["follower_speed_mps"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!(speeds.iter().all(|&v| v >= 0.0) && speeds[59] < 0.5);
    server.stop().await;
}

#[tokio::test]
async fn a_model_without_the_envelope_serves_its_network() {
    let server = trained("[model]\nenvelope = false").await;
    let start = towards_a_standing_leader(10.0, 7.0);
    let predicted = server.post(PREDICT, &json!({"windows": [start]})).await.expect(200);
    let one = &predicted["predictions"][0];
    assert_eq!(one["accel_mps2"], one["raw_accel_mps2"]);
    assert!(!one["flags"].as_array().unwrap().contains(&json!("envelope")));
    let drive = json!({"initial": start, "leader_speed_mps": vec![0.0; 60]});
    assert_eq!(server.post(SIMULATE, &drive).await.expect(200)["collided"], true);
    server.stop().await;
}
