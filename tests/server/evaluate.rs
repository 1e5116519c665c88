use reqwest::Method;
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use crate::support::events::events;
use crate::support::server::{Answer, Server};
use crate::uploads::follownet_csv;

const PATH: &str = "/v1/models/default/evaluate";
const QUICK: &str = "[evaluate.calibration]\nevaluations = 60";

async fn evaluate(server: &Server, query: &str, events: &[Value]) -> Answer {
    server.post(&format!("{PATH}{query}"), &json!({"events": events})).await
}

/// Fast traffic is version 1, slow traffic version 2; both promoted.
async fn learned(settings: &str) -> Server {
    let server = Server::start_with(settings).await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    server.learn("default", "slow", &events("f", 16, 6.0)).await;
    server
}

fn tests_of(events: Vec<Value>) -> Vec<Value> {
    events.into_iter().filter(|event| event["split"] == "test").collect()
}

#[tokio::test]
async fn on_its_own_test_events_a_version_gets_its_own_evaluation() {
    let server = learned(QUICK).await;
    let (fast, slow) = (tests_of(events("e", 16, 16.0)), tests_of(events("f", 16, 6.0)));
    let mut own = Vec::new();
    for version in 1..=2 {
        let evaluation = server.get(&format!("/v1/models/default/versions/{version}/evaluation")).await.expect(200);
        own.push(evaluation["tasks"].clone());
    }
    let answer = evaluate(&server, "?versions=2,1&regime=fast", &fast).await.expect(200);
    assert_eq!((&answer["accepted"], &answer["versions"][0]["stage"]), (&json!(4), &json!(2)));
    assert_eq!(answer["versions"][0]["tasks"], json!([own[1][0]]));
    assert_eq!(answer["versions"][1]["tasks"], json!([own[0][0]]));
    assert_eq!(answer["versions"][0]["measures"]["average"]["value"], own[1][0]["spacing_mse"]);
    assert_eq!(answer["versions"][0]["measures"]["forgetting_ratio"]["value"], own[1][0]["forgetting_ratio"]);
    assert_eq!(answer["references"], json!([]));
    // The live version, from the rows of another format, in another order.
    let rows: Vec<Value> = slow.iter().rev().cloned().collect();
    let path = format!("{PATH}?preset=follownet&dt_s=0.1&regime=slow");
    let request = server.request(Method::POST, &path).header("content-type", "text/csv").body(follownet_csv(&rows));
    let answer = server.send(request).await.expect(200);
    assert_eq!(answer["versions"][0]["version"], 2);
    assert_eq!(answer["versions"][0]["tasks"], json!([own[1][1]]));
    assert!(answer["versions"][0]["tasks"][0]["before"].is_number());
    server.stop().await;
}

#[tokio::test]
async fn a_recording_of_a_road_is_evaluated_by_the_events_in_it() {
    let server = learned(QUICK).await;
    let body = include_bytes!("../golden/scenes/fcd.xml.gz").to_vec();
    let request = server.request(Method::POST, &format!("{PATH}?references=idm&max_duration_s=20"));
    let request = request.header("content-type", "application/xml").header("content-encoding", "gzip").body(body);
    let answer = server.send(request).await.expect(200);
    let extraction = &answer["summary"]["extraction"];
    assert_eq!((&extraction["rows"], &extraction["events"]), (&json!(3435), &answer["accepted"]));
    assert_eq!(answer["versions"][0]["tasks"][0]["events"], answer["accepted"]);
    assert_eq!(answer["references"][0]["tasks"][0]["events"], answer["accepted"]);
    server.stop().await;
}

#[tokio::test]
async fn nothing_of_an_evaluation_is_kept() {
    let server = learned(QUICK).await;
    let seen = async || {
        let mut answers = Vec::new();
        for path in ["", "/batches", "/tasks", "/versions", "/history"] {
            answers.push(server.get(&format!("/v1/models/default{path}")).await.expect(200).text);
        }
        answers
    };
    let before = seen().await;
    let fresh = events("g", 5, 10.0);
    evaluate(&server, "?references=idm&regime=middle", &fresh).await.expect(200);
    assert_eq!(seen().await, before);
    let stored = server.upload("default", "?regime=middle", &fresh).await.expect(201);
    assert_eq!((&stored["accepted"], &stored["duplicates"]), (&json!(5), &json!(0)));
    server.stop().await;
}

#[tokio::test]
async fn bad_events_are_listed_as_an_upload_lists_them_and_good_ones_are_driven() {
    let server = learned(QUICK).await;
    let mut sent = events("g", 5, 16.0);
    sent[1]["spacing_m"][7] = json!(-1.0);
    sent[3]["colour"] = json!("red");
    sent.push(sent[0].clone());
    let answer = evaluate(&server, "?regime=fast", &sent).await.expect(200);
    assert_eq!(
        (&answer["accepted"], &answer["duplicates"], &answer["rejected_count"]),
        (&json!(3), &json!(1), &json!(2))
    );
    assert_eq!(answer["versions"][0]["tasks"][0]["events"], 3);
    let uploaded = server.upload("default", "?regime=fast", &sent).await.expect(201);
    assert_eq!((&answer["rejected"], &answer["summary"]), (&uploaded["rejected"], &uploaded["summary"]));
    let refused = evaluate(&server, "", &sent[3..4]).await.expect_problem(422, "no_event_accepted");
    assert_eq!(refused["rejected"][0]["index"], 0);
    evaluate(&server, "", &[]).await.expect_problem(422, "no_event_accepted");
    let request = server.request(Method::POST, PATH).header("content-type", "application/json");
    server.send(request.body(r#"{"events": ["#)).await.expect_problem(400, "truncated_body");
    server.stop().await;
}

#[tokio::test]
async fn reference_drivers_are_calibrated_on_what_the_line_has_learned() {
    let server = learned(QUICK).await;
    let sent = events("g", 5, 16.0);
    let answer = evaluate(&server, "?references=idm,gipps,constant&regime=fast", &sent).await.expect(200);
    let again = evaluate(&server, "?references=idm,gipps,constant&regime=fast", &sent).await.expect(200);
    assert_eq!(answer.text, again.text);
    let names: Vec<_> = (0..3).map(|i| answer["references"][i]["reference"].clone()).collect();
    assert_eq!(names, ["idm", "gipps", "constant"]);
    let idm = &answer["references"][0]["tasks"][0];
    assert_eq!((&idm["regime"], &idm["events"]), (&json!("fast"), &json!(5)));
    let calibration = &idm["calibration"];
    assert_eq!((&calibration["scope"], &calibration["version"]), (&json!("regime"), &json!(2)));
    assert_eq!((&calibration["events"], &calibration["evaluations"]), (&json!(12), &json!(60)));
    assert!((0.1..=5.0).contains(&idm["parameters"]["time_headway_s"].as_f64().unwrap()), "{idm}");
    assert_eq!(answer["references"][0]["measures"]["average"]["value"], idm["spacing_mse"]);
    let constant = &answer["references"][2]["tasks"][0];
    assert_eq!((&constant["parameters"], &constant["calibration"]["scope"]), (&json!({}), &json!("published")));
    let error = |reference: &Value| reference["spacing_mse"].as_f64().unwrap();
    assert!(error(idm) < error(constant), "{idm} {constant}");
    // A regime that the line has not learned.
    let answer = evaluate(&server, "?references=gipps&regime=middle", &events("h", 4, 10.0)).await.expect(200);
    let (version, gipps) = (&answer["versions"][0]["tasks"][0], &answer["references"][0]["tasks"][0]);
    assert_eq!((&version["stage"], &version["learned_version"]), (&json!(null), &json!(null)));
    assert!(version["spacing_mse"].is_number() && version["diagonal_spacing_mse"].is_null());
    assert_eq!((&gipps["calibration"]["scope"], &gipps["calibration"]["events"]), (&json!("all_regimes"), &json!(24)));
    // On the line of version 1 there is fast traffic alone.
    let answer = evaluate(&server, "?versions=1&references=gipps&regime=slow", &sent).await.expect(200);
    assert_eq!(answer["references"][0]["tasks"][0]["calibration"]["events"], 12);
    server.stop().await;
}

#[tokio::test]
async fn without_events_to_calibrate_on_a_reference_driver_is_as_published() {
    let server = learned("[evaluate.calibration]\nmax_events = 0").await;
    let answer = evaluate(&server, "?references=idm&regime=fast", &events("g", 4, 16.0)).await.expect(200);
    let idm = &answer["references"][0]["tasks"][0];
    assert_eq!(
        idm["calibration"],
        json!({"scope": "published", "version": null, "events": 0, "spacing_mse": null, "evaluations": 0})
    );
    assert_eq!((&idm["parameters"]["time_headway_s"], &idm["parameters"]["jam_spacing_m"]), (&json!(1.6), &json!(2.0)));
    server.stop().await;
}

#[tokio::test]
async fn what_cannot_be_evaluated_is_named() {
    let server = Server::start_with("[evaluate]\nmax_steps = 200\nmax_versions = 2").await;
    let few = events("g", 2, 16.0);
    evaluate(&server, "", &few).await.expect_problem(409, "no_live_version");
    evaluate(&server, "?versions=1", &few).await.expect_problem(404, "version_not_found");
    server.learn("default", "fast", &events("e", 4, 16.0)).await;
    evaluate(&server, "?versions=1,2", &few).await.expect_problem(404, "version_not_found");
    for query in ["?versions=", "?versions=1,x", "?versions=01", "?versions=1,2,3", "?references=idm,krauss", "?dt_s=0"]
    {
        let answer = evaluate(&server, query, &few).await.expect_problem(422, "invalid_query");
        let parameter = query.trim_start_matches('?').split('=').next().unwrap();
        assert_eq!(answer["errors"][0]["parameter"], parameter, "{}", answer.text);
    }
    evaluate(&server, "?colour=red", &few).await.expect_problem(422, "invalid_query");
    evaluate(&server, "?versions=1,1", &few).await.expect(200);
    evaluate(&server, "", &events("g", 6, 16.0)).await.expect_problem(413, "body_too_large");
    let request = server.request(Method::POST, PATH).header("content-type", "image/png");
    server.send(request).await.expect_problem(415, "unsupported_media_type");
    server.stop().await;
}

#[tokio::test]
async fn an_evaluation_too_many_is_asked_to_come_back() {
    let server = Server::start_with("[server]\nconcurrent_evaluations = 1").await;
    server.learn("default", "fast", &events("e", 4, 16.0)).await;
    let mut slow = tokio::net::TcpStream::connect(server.url.trim_start_matches("http://")).await.unwrap();
    let head = format!(
        "POST {PATH} HTTP/1.1\r\nhost: x\r\ncontent-type: application/x-ndjson\r\ncontent-length: 1\r\n\
         expect: 100-continue\r\nconnection: close\r\n\r\n"
    );
    slow.write_all(head.as_bytes()).await.unwrap();
    // The server asks for the body once the evaluation has its place.
    let mut asked = [0; 25];
    slow.read_exact(&mut asked).await.unwrap();
    assert_eq!(&asked, b"HTTP/1.1 100 Continue\r\n\r\n");
    let sent = events("g", 2, 16.0);
    assert_eq!(evaluate(&server, "", &sent).await.expect_problem(503, "busy").header("retry-after"), "1");
    slow.write_all(b"{").await.unwrap();
    let mut answer = String::new();
    slow.read_to_string(&mut answer).await.unwrap();
    assert!(answer.starts_with("HTTP/1.1 400"), "{answer}");
    evaluate(&server, "", &sent).await.expect(200);
    server.stop().await;
}
