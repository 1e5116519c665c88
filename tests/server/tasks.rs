use futures_util::StreamExt;
use reqwest::Method;
use serde_json::{Value, json};

use crate::support::contract;
use crate::support::events::events;
use crate::support::server::Server;

const TASKS: &str = "/v1/models/default/tasks";

#[tokio::test]
async fn a_task_learns_what_is_pending_and_makes_a_version() {
    let server = Server::start().await;
    server.upload("default", "?regime=fast", &events("e", 12, 12.0)).await.expect(201);
    let task = server.post(TASKS, &json!({"batches": "pending"})).await.expect(202);
    let id = task["task_id"].as_str().unwrap();
    assert_eq!((task.header("location"), &task["task_ids"]), (&*format!("{TASKS}/{id}"), &json!([id])));
    assert_eq!((&task["regime"], &task["batches"]), (&json!("fast"), &json!(["b1"])));
    let ended = server.end_of("default", id).await;
    assert_eq!(
        (&ended["state"], &ended["version"], &ended["stage"]),
        (&json!("succeeded"), &json!(1), &json!(1)),
        "{}",
        ended.text
    );
    assert_eq!((&ended["progress"], &ended["attempt"], &ended["error"]), (&json!(1.0), &json!(1), &json!(null)));
    let model = server.get("/v1/models/default").await.expect(200);
    assert_eq!((&model["live"], &model["head"]), (&json!(1), &json!(1)));
    assert_eq!(server.get("/v1/models/default/batches/b1").await["events"]["learned"], 12);
    let metrics = server.get("/metrics").await.text;
    assert!(metrics.contains(r#"headway_live_version{model="default"} 1"#), "{metrics}");
    server.stop().await;
}

#[tokio::test]
async fn pending_events_of_several_regimes_make_one_task_each() {
    let server = Server::start().await;
    server.upload("default", "?regime=slow", &events("e", 8, 6.0)).await.expect(201);
    server.upload("default", "?regime=fast", &events("f", 8, 16.0)).await.expect(201);
    let tasks = server.post(TASKS, &json!({"batches": "pending"})).await.expect(202);
    assert_eq!(tasks["task_ids"].as_array().unwrap().len(), 2);
    for (id, regime, stage) in [("t1", "slow", 1), ("t2", "fast", 2)] {
        let ended = server.end_of("default", id).await;
        assert_eq!(
            (&ended["state"], &ended["regime"], &ended["stage"]),
            (&json!("succeeded"), &json!(regime), &json!(stage))
        );
    }
    let list = server.get(&format!("{TASKS}?page_size=1")).await.expect(200);
    assert_eq!(list["tasks"][0]["task_id"], "t1");
    assert!(list["next_page_token"].is_string());
    server.stop().await;
}

#[tokio::test]
async fn a_schedule_makes_the_task_in_the_upload() {
    let server = Server::start_with("[model]\nschedule = { min_events = 8, max_wait_s = 3600 }").await;
    assert_eq!(server.upload("default", "", &events("e", 4, 10.0)).await.expect(201)["task_ids"], json!([]));
    let due = server.upload("default", "", &events("f", 4, 10.0)).await.expect(201);
    let id = due["task_ids"][0].as_str().unwrap();
    assert_eq!(server.end_of("default", id).await["batches"], json!(["b1", "b2"]));
    server.stop().await;
}

#[tokio::test]
async fn a_wish_is_refused_for_what_is_wrong_with_it() {
    let server = Server::start().await;
    server.upload("default", "", &events("e", 8, 10.0)).await.expect(201);
    for (wish, pointer) in [
        (json!({"batches": "all"}), "/batches"),
        (json!({"batches": []}), "/batches"),
        (json!({"batches": ["b1", "b9"]}), "/batches/1"),
        (json!({"batches": ["x"]}), "/batches/0"),
        (json!({"batches": "pending", "regime": "a b"}), "/regime"),
        (json!({"batches": "pending", "where": {"mean_speed_mps": [3.0, 2.0]}}), "/where/mean_speed_mps"),
    ] {
        let answer = server.post(TASKS, &wish).await.expect_problem(422, "invalid_body");
        assert_eq!(answer["errors"][0]["pointer"], pointer, "{wish}");
    }
    let hidden = json!({"batches": "pending", "settings": {"hidden": 3}});
    server.post(TASKS, &hidden).await.expect_problem(422, "invalid_settings");
    let nobody = json!({"batches": "pending", "where": {"mean_speed_mps": [90.0, 99.0]}});
    server.post(TASKS, &nobody).await.expect_problem(409, "nothing_pending");
    assert_eq!(server.get(TASKS).await["tasks"], json!([]));
    server.stop().await;
}

#[tokio::test]
async fn a_task_without_training_events_fails_and_its_events_are_held() {
    let server = Server::start().await;
    let mut events = events("e", 4, 10.0);
    for event in &mut events {
        event["split"] = json!("test");
    }
    server.upload("default", "", &events).await.expect(201);
    server.post(TASKS, &json!({"batches": "pending"})).await.expect(202);
    let ended = server.end_of("default", "t1").await;
    assert_eq!((&ended["state"], &ended["error"]["code"]), (&json!("failed"), &json!("no_training_events")));
    assert_eq!(server.get("/v1/models/default/batches/b1").await["events"]["held"], 4);
    server.stop().await;
}

#[tokio::test]
async fn a_queued_and_a_running_task_are_cancelled_once() {
    let server = Server::start_with("[model]\nepochs = 1000").await;
    server.upload("default", "?regime=a", &events("e", 40, 10.0)).await.expect(201);
    server.upload("default", "?regime=b", &events("f", 8, 10.0)).await.expect(201);
    server.post(TASKS, &json!({"batches": "pending"})).await.expect(202);
    let cancelled = server.post(&format!("{TASKS}/t2/cancel"), &json!({})).await.expect(200);
    assert_eq!(cancelled["state"], "cancelled");
    server.post(&format!("{TASKS}/t2/cancel"), &json!({})).await.expect_problem(409, "task_ended");
    server.post(&format!("{TASKS}/t1/cancel"), &json!({})).await.expect(200);
    assert_eq!(server.end_of("default", "t1").await["state"], "cancelled");
    assert_eq!(server.get("/v1/models/default/batches/b1").await["events"]["set_aside"], 40);
    assert_eq!(server.get("/v1/models/default/versions").await["versions"], json!([]));
    server.stop().await;
}

#[tokio::test]
async fn a_paused_model_waits_until_it_is_resumed() {
    let server = Server::start().await;
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "", &events("e", 8, 10.0)).await.expect(201);
    server.post(TASKS, &json!({"batches": "pending"})).await.expect(202);
    assert_eq!(server.get(&format!("{TASKS}/t1?wait_s=0.3")).await.expect(200)["state"], "queued");
    server.post("/v1/models/default/resume", &json!({})).await.expect(200);
    assert_eq!(server.end_of("default", "t1").await["state"], "succeeded");
    server.stop().await;
}

#[tokio::test]
async fn waiting_is_bounded() {
    let server = Server::start().await;
    server.upload("default", "", &events("e", 8, 10.0)).await.expect(201);
    server.post(TASKS, &json!({"batches": "pending"})).await.expect(202);
    for wait in ["61", "-1", "NaN", "x"] {
        server.get(&format!("{TASKS}/t1?wait_s={wait}")).await.expect_problem(422, "invalid_query");
    }
    server.end_of("default", "t1").await;
    server.stop().await;
}

#[tokio::test]
async fn a_task_asked_for_again_under_its_key_is_made_once() {
    let server = Server::start().await;
    server.upload("default", "", &events("e", 8, 10.0)).await.expect(201);
    let wish = json!({"batches": ["b1"]});
    let first = server.post_with_key(TASKS, "k", &wish).await.expect(202);
    server.end_of("default", "t1").await;
    assert_eq!(server.post_with_key(TASKS, "k", &wish).await.expect(202).text, first.text);
    assert_eq!(server.get(TASKS).await["tasks"].as_array().unwrap().len(), 1);
    server.stop().await;
}

/// A task's stream to its end, which begins before the task does: name and data of each event.
async fn streamed(server: &Server, uploaded: &[Value]) -> Vec<(String, Value)> {
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "?regime=fast", uploaded).await.expect(201);
    server.post(TASKS, &json!({"batches": "pending"})).await.expect(202);
    let response = server.request(Method::GET, &format!("{TASKS}/t1/progress")).send().await.unwrap();
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    server.post("/v1/models/default/resume", &json!({})).await.expect(200);
    let mut stream = response.bytes_stream();
    let mut text = String::new();
    while let Some(chunk) = stream.next().await {
        text += std::str::from_utf8(&chunk.unwrap()).unwrap();
    }
    let named = |event: &str| {
        let (name, data) = event.strip_prefix("event: ")?.split_once("\ndata: ")?;
        Some((name.to_owned(), serde_json::from_str(data).unwrap()))
    };
    text.split("\n\n").filter_map(named).collect()
}

#[tokio::test]
async fn progress_is_streamed_until_the_end() {
    let server = Server::start_with("[model]\nepochs = 60\n[server]\nprogress_interval_s = 0.01").await;
    let events = streamed(&server, &events("e", 16, 10.0)).await;
    for (name, data) in &events {
        contract::check_schema(if name == "task" { "Task" } else { "Progress" }, data);
    }
    let (name, last) = events.last().unwrap();
    assert_eq!((name.as_str(), &last["state"]), ("task", &json!("succeeded")));
    let progress: Vec<_> = events.iter().filter(|(name, _)| name == "progress").map(|(_, data)| data).collect();
    assert!(progress.is_sorted_by_key(|p| p["update"].as_u64()));
    assert_eq!(progress.last().unwrap()["update"], 120, "the last of it comes before the end");
    assert!(progress.iter().all(|p| p["interim"].is_null()), "there are no validation events");
    server.stop().await;
}

#[tokio::test]
async fn progress_tells_how_the_network_drives_validation_events_after_each_epoch() {
    let server =
        Server::start_with("[model]\nepochs = 60\ntest_reservoir = 4\n[server]\nprogress_interval_s = 0.01").await;
    let mut uploaded = events("e", 16, 10.0);
    for event in &mut uploaded[..6] {
        event["split"] = json!("validation");
    }
    let events = streamed(&server, &uploaded).await;
    let progress: Vec<_> = events.iter().filter(|(name, _)| name == "progress").map(|(_, data)| data).collect();
    for progress in &progress {
        contract::check_schema("Progress", progress);
        let epoch = progress["epoch"].as_u64().unwrap();
        let done = progress["interim"]["epoch"].as_u64().unwrap_or(0);
        assert!(done == epoch || done + 1 == epoch, "{progress}");
    }
    let last = &progress.last().unwrap()["interim"];
    assert_eq!((&last["epoch"], &last["regime"], &last["events"]), (&json!(60), &json!("fast"), &json!(4)));
    assert!(last["spacing_mse"].as_f64().unwrap() > 0.0 && last["collision_rate_percent"].is_number());
    server.stop().await;
}

#[tokio::test]
async fn a_task_takes_only_events_of_the_speeds_it_names() {
    let server = Server::start().await;
    let mixed = [events("e", 8, 6.0), events("f", 8, 16.0)].concat();
    server.upload("default", "", &mixed).await.expect(201);
    let slow = json!({"batches": "pending", "where": {"mean_speed_mps": [0.0, 10.0]}});
    server.post(TASKS, &slow).await.expect(202);
    assert_eq!(server.end_of("default", "t1").await["state"], "succeeded");
    let counts = server.get("/v1/models/default/batches/b1").await["events"].clone();
    assert_eq!((&counts["learned"], &counts["pending"]), (&json!(8), &json!(8)));
    assert_eq!(server.get("/v1/models/default/versions/1").await["events"], 6);
    server.stop().await;
}

#[tokio::test]
async fn a_running_task_is_held_and_goes_on_to_the_same_bits() {
    let server = Server::start_with("[model]\nepochs = 60").await;
    for model in ["held", "through"] {
        server.post("/v1/models", &json!({"model": model, "method": "ewc"})).await.expect(201);
    }
    server.learn("through", "fast", &events("e", 16, 12.0)).await;
    server.upload("held", "?regime=fast", &events("e", 16, 12.0)).await.expect(201);
    server.post("/v1/models/held/tasks", &json!({"batches": "pending"})).await.expect(202);
    let task = "/v1/models/held/tasks/t2";
    while server.get(task).await["progress"] == json!(0.0) {
        tokio::task::yield_now().await;
    }
    server.post("/v1/models/held/pause", &json!({})).await.expect(200);
    server.post("/v1/models/held/resume", &json!({})).await.expect(200);
    assert_eq!(server.end_of("held", "t2").await["state"], "succeeded");
    let held = server.get("/v1/models/held/versions/1").await.expect(200);
    let through = server.get("/v1/models/through/versions/1").await.expect(200);
    assert_eq!(held["weights_sha256"], through["weights_sha256"]);
    server.stop().await;
}

#[tokio::test]
async fn regimes_by_speed_make_a_task_for_each_band_that_is_due() {
    let rule = "regimes = { by = \"mean_speed_mps\", edges = [9.86, 12.46], names = [\"slow\", \"middle\", \"fast\"] }";
    let schedule = "schedule = { min_events = 8, max_wait_s = 3600 }";
    let server = Server::start_with(&format!("[model]\n{rule}\n{schedule}")).await;
    let mixed = [events("e", 8, 16.0), events("f", 8, 6.0), events("g", 4, 11.0)].concat();
    let due = server.upload("default", "", &mixed).await.expect(201);
    assert_eq!(due["summary"]["regimes"], json!({"fast": 8, "middle": 4, "slow": 8}));
    let mut learned = Vec::new();
    for id in due["task_ids"].as_array().unwrap() {
        let ended = server.end_of("default", id.as_str().unwrap()).await;
        learned.push(ended["regime"].clone());
    }
    assert_eq!(learned, ["fast", "slow"]);
    assert_eq!(server.get("/v1/models/default/batches/b1").await["events"]["pending"], 4);
    server.stop().await;
}

#[tokio::test]
async fn training_that_diverges_fails_holds_its_events_and_leaves_no_version() {
    let server = Server::start().await;
    server.post("/v1/models", &json!({"model": "m", "method": "naive"})).await.expect(201);
    server.learn("m", "fast", &events("e", 12, 16.0)).await;
    server.upload("m", "?regime=slow", &events("f", 12, 3.0)).await.expect(201);
    let wild = json!({"batches": "pending", "settings": {"learning_rate": 1.0, "epochs": 5}});
    server.post("/v1/models/m/tasks", &wild).await.expect(202);
    let ended = server.end_of("m", "t2").await;
    assert_eq!((&ended["state"], &ended["error"]["code"]), (&json!("failed"), &json!("diverged")), "{}", ended.text);
    assert_eq!(server.get("/v1/models/m/batches/b2").await["events"]["held"], 12);
    let model = server.get("/v1/models/m").await.expect(200);
    assert_eq!((&model["live"], &model["head"]), (&json!(1), &json!(1)));
    server.post("/v1/models/m/tasks", &json!({"batches": "pending"})).await.expect_problem(409, "nothing_pending");
    server.stop().await;
}
