use reqwest::Method;
use serde_json::json;

use crate::support::events::events;
use crate::support::server::Server;

#[tokio::test]
async fn versions_are_listed_with_their_lineage_and_evaluated_on_every_regime() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    server.learn("default", "slow", &events("f", 16, 6.0)).await;
    let list = server.get("/v1/models/default/versions").await.expect(200);
    let versions = list["versions"].as_array().unwrap();
    assert_eq!((&versions[0]["parent"], &versions[1]["parent"]), (&json!(null), &json!(1)));
    assert_eq!(
        (&versions[0]["regime"], &versions[1]["stage"], &versions[0]["events"]),
        (&json!("fast"), &json!(2), &json!(12))
    );
    assert_eq!(versions[1], server.get("/v1/models/default/versions/2").await.expect(200).body);
    let evaluation = server.get("/v1/models/default/versions/2/evaluation").await.expect(200);
    let tasks = evaluation["tasks"].as_array().unwrap();
    assert_eq!((&tasks[0]["regime"], &tasks[1]["regime"]), (&json!("fast"), &json!("slow")));
    assert_eq!((&tasks[0]["events"], &tasks[0]["stage"]), (&json!(4), &json!(1)));
    assert!(tasks[0]["before"].is_null() && tasks[1]["before"].is_number());
    for task in tasks {
        let served = &task["served"];
        assert_eq!(served["acted_percent"], json!(0.0), "nothing about this traffic is dangerous");
        assert_eq!(served["held_percent"], json!(0.0), "nor does anybody stop");
        assert_eq!(task["served"]["spacing_mse"], task["spacing_mse"]);
    }
    for measure in ["average", "forgetting", "forgetting_ratio", "backward_transfer"] {
        assert!(evaluation["measures"][measure]["value"].is_number(), "{}", evaluation.text);
    }
    let first = server.get("/v1/models/default/versions/1/evaluation").await.expect(200);
    assert_eq!(first["measures"]["forgetting"]["value"], json!(null));
    server.stop().await;
}

#[tokio::test]
async fn only_the_note_of_a_version_changes() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 8, 16.0)).await;
    let path = "/v1/models/default/versions/1";
    let before = server.get(path).await.expect(200);
    let patch = |body| server.request(Method::PATCH, path).json(&body);
    let noted = server.send(patch(json!({"note": "the week of the snow"}))).await.expect(200);
    assert_eq!(noted["note"], "the week of the snow");
    server.send(patch(json!({}))).await.expect_problem(422, "invalid_body");
    server.send(patch(json!({"weights": 1}))).await.expect_problem(422, "invalid_body");
    server.send(patch(json!({"note": "x".repeat(5000)}))).await.expect_problem(422, "invalid_body");
    assert_eq!(server.send(patch(json!({"note": null}))).await.expect(200).body, before.body);
    server.stop().await;
}

#[tokio::test]
async fn a_regime_without_test_events_is_zero_events_and_nulls() {
    let server = Server::start().await;
    let mut events = events("e", 8, 10.0);
    for event in &mut events {
        event["split"] = json!("train");
    }
    server.learn("default", "fast", &events).await;
    let evaluation = server.get("/v1/models/default/versions/1/evaluation").await.expect(200);
    assert_eq!((&evaluation["tasks"][0]["events"], &evaluation["tasks"][0]["spacing_mse"]), (&json!(0), &json!(null)));
    assert_eq!(evaluation["measures"]["average"]["value"], json!(null));
    server.stop().await;
}

#[tokio::test]
async fn a_regime_that_repeats_is_measured_against_its_last_stage() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    server.learn("default", "slow", &events("f", 16, 6.0)).await;
    server.learn("default", "fast", &events("g", 16, 16.0)).await;
    let evaluation = server.get("/v1/models/default/versions/3/evaluation").await.expect(200);
    let fast = &evaluation["tasks"][0];
    assert_eq!((&fast["regime"], &fast["stage"], &fast["events"]), (&json!("fast"), &json!(3), &json!(8)));
    assert_eq!(fast["diagonal_spacing_mse"], fast["spacing_mse"]);
    assert!(fast["before"].is_number());
    assert_eq!(evaluation["tasks"].as_array().unwrap().len(), 2);
    server.stop().await;
}

#[tokio::test]
async fn the_first_stage_of_naive_ewc_and_mas_has_the_same_bits() {
    let server = Server::start().await;
    let mut weights = Vec::new();
    for method in ["naive", "ewc", "mas"] {
        server.post("/v1/models", &json!({"model": method, "method": method})).await.expect(201);
        server.learn(method, "fast", &events("e", 16, 16.0)).await;
        let version = server.get(&format!("/v1/models/{method}/versions/1")).await.expect(200);
        assert_eq!(version["importance"].is_null(), method == "naive");
        weights.push(version["weights_sha256"].clone());
    }
    assert_eq!([&weights[0], &weights[0]], [&weights[1], &weights[2]]);
    server.stop().await;
}
