use headway::car_following::{TrafficRegime, TrafficSettings, generate};
use serde_json::{Value, json};

use crate::support::server::{Answer, Server};

const AUTO: &str = "[model]\nstrength = \"auto\"\nepochs = 6\nminibatch = 4";

const SPLITS: [&str; 8] = ["train", "train", "validation", "train", "test", "train", "validation", "train"];

/// Generated traffic.
fn traffic(regime: TrafficRegime, events: usize) -> Vec<Value> {
    let settings = TrafficSettings { dt_s: 0.1, min_steps: 40, max_steps: 40 };
    let body = |(i, generated): (usize, headway::car_following::GeneratedEvent)| {
        let event = &generated.event;
        json!({
            "event_id": generated.event_id,
            "dt_s": event.dt_s(),
            "split": SPLITS[i % SPLITS.len()],
            "spacing_m": event.spacing_m(),
            "follower_speed_mps": event.follower_speed_mps(),
            "leader_speed_mps": event.leader_speed_mps(),
        })
    };
    generate(regime, 1, events, &settings).into_iter().enumerate().map(body).collect()
}

/// A server that has learned fast and slow traffic, finding the strength of the latter.
async fn learned(settings: &str) -> (Server, Answer) {
    let server = Server::start_with(settings).await;
    server.learn("default", "fast", &traffic(TrafficRegime::Fast, 40)).await;
    server.learn("default", "slow", &traffic(TrafficRegime::Slow, 40)).await;
    let version = server.get("/v1/models/default/versions/2").await.expect(200);
    (server, version)
}

fn numbers(of: &Value) -> Vec<f64> {
    of.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// What the rule takes, from nothing but what the record tells of errors and collisions.
fn chosen_by_hand(search: &Value) -> f64 {
    let diagonal = numbers(&search["naive_diagonal"]);
    let figures = |candidate: &Value| {
        let mse = numbers(&candidate["spacing_mse"]);
        let (old, new) = (mse[0] / diagonal[0], mse[1] / diagonal[1]);
        let strength = candidate["strength"].as_f64().unwrap();
        (strength, candidate["collisions"].as_u64().unwrap(), f64::midpoint(old, new), old.max(new).max(1.0))
    };
    let mut left: Vec<_> = search["candidates"].as_array().unwrap().iter().map(figures).collect();
    let fewest = left.iter().map(|one| one.1).min().unwrap();
    left.retain(|one| one.1 == fewest);
    let least = left.iter().map(|one| one.2).fold(f64::INFINITY, f64::min);
    left.retain(|one| one.2 <= 1.05 * least);
    let least = left.iter().map(|one| one.3).fold(f64::INFINITY, f64::min);
    left.retain(|one| one.3 <= 1.05 * least);
    left.iter().map(|one| one.0).fold(0.0, f64::max)
}

#[tokio::test]
async fn a_strength_is_searched_on_validation_events_and_the_version_tells_what_was_seen() {
    let (server, version) = learned(AUTO).await;
    let search = &version["strength_search"];
    assert_eq!(version["settings"]["strength"], "auto");
    assert_eq!(version["strength"], search["chosen"]);
    assert!(version["lambda"].as_f64().unwrap() > 0.0);
    let strengths: Vec<_> = search["candidates"].as_array().unwrap().iter().map(|one| &one["strength"]).collect();
    assert!(strengths.len() == 5 && strengths.contains(&&version["strength"]), "{strengths:?}");
    assert_eq!(version["strength"], json!(chosen_by_hand(search)), "{search:#}");
    assert_eq!(
        search["regimes"],
        json!([{"regime": "fast", "events": 10, "earlier": true}, {"regime": "slow", "events": 10, "earlier": false}])
    );
    let first = server.get("/v1/models/default/versions/1").await.expect(200);
    assert_eq!((&first["strength_search"], &first["lambda"]), (&Value::Null, &Value::Null));

    // The strength alone makes the version: told by hand it comes to the same.
    let wish = format!("[model]\nstrength = {}\nepochs = 6\nminibatch = 4", version["strength"]);
    let (told, by_hand) = learned(&wish).await;
    assert_eq!(by_hand["weights_sha256"], version["weights_sha256"]);
    assert_eq!(by_hand["strength_search"], Value::Null);
    told.stop().await;

    let (again, same) = learned(&format!("{AUTO}\n[training]\ntraining_threads = 2")).await;
    assert_eq!(same["weights_sha256"], version["weights_sha256"]);
    assert_eq!(&same["strength_search"], search, "whatever the threads");
    again.stop().await;
    server.stop().await;
}

#[tokio::test]
async fn a_server_that_stops_in_a_search_goes_on_in_it_and_ends_with_the_same_bits() {
    let longer = AUTO.replace("epochs = 6", "epochs = 40");
    let (server, expected) = learned(&longer).await;
    server.stop().await;
    let server = Server::start_with(&longer).await;
    server.learn("default", "fast", &traffic(TrafficRegime::Fast, 40)).await;
    server.upload("default", "?regime=slow", &traffic(TrafficRegime::Slow, 40)).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    let task = "/v1/models/default/tasks/t2";
    while server.get(task).await["progress"].as_f64().unwrap() < 0.3 {
        tokio::task::yield_now().await;
    }
    let server = server.restart().await;
    let ended = server.end_of("default", "t2").await;
    assert_eq!(ended["state"], "succeeded", "{}", ended.text);
    let version = server.get("/v1/models/default/versions/2").await.expect(200);
    assert_eq!(version["weights_sha256"], expected["weights_sha256"]);
    assert_eq!(version["strength_search"], expected["strength_search"]);
    server.stop().await;
}

#[tokio::test]
async fn a_search_beside_lambda_is_refused_by_name() {
    let server = Server::start().await;
    let model = json!({"model": "m", "method": "ewc", "settings": {"strength": "auto", "lambda": 5.0}});
    let refused = server.post("/v1/models", &model).await.expect_problem(422, "invalid_settings");
    assert_eq!(refused["errors"][0]["pointer"], "/settings/strength");
    let model = json!({"model": "m", "method": "naive", "settings": {"strength": "auto"}});
    let made = server.post("/v1/models", &model).await.expect(201);
    assert_eq!(made["settings"]["strength"], "auto", "methods that do not consolidate ignore it");
    server.stop().await;
}

#[tokio::test]
async fn the_progress_of_a_search_counts_all_of_it() {
    let server = Server::start_with(&format!("{AUTO}\n[server]\nprogress_interval_s = 0.01")).await;
    server.learn("default", "fast", &traffic(TrafficRegime::Fast, 40)).await;
    server.upload("default", "?regime=slow", &traffic(TrafficRegime::Slow, 40)).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    let stream = server.get("/v1/models/default/tasks/t2/progress").await.expect(200).text;
    let told = stream.split("\n\n").filter_map(|event| event.strip_prefix("event: progress\ndata: "));
    let told: Vec<Value> = told.map(|data| serde_json::from_str(data).unwrap()).collect();
    for progress in &told {
        crate::support::contract::check_schema("Progress", progress);
        assert_eq!(progress["search"]["of"], 7);
    }
    assert!(told.is_sorted_by_key(|progress| progress["progress"].as_f64()));
    let last = told.last().unwrap();
    assert_eq!((&last["search"]["learning"], &last["progress"]), (&json!(7), &json!(1.0)));
    server.stop().await;
}
