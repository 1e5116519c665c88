use headway::store::verify::verify;
use reqwest::Method;
use reqwest::header::CONTENT_TYPE;
use serde_json::{Map, Value, json};

use crate::artifact::download;
use crate::lived::execute;
use crate::support::events::{events, window};
use crate::support::server::{Answer, Server};

const OCTETS: &str = "application/octet-stream";

async fn import(server: &Server, model: &str, file: &[u8]) -> Answer {
    let path = format!("/v1/models/{model}/versions");
    let request = server.request(Method::POST, &path).header(CONTENT_TYPE, OCTETS).body(file.to_vec());
    server.send(request).await
}

async fn file(server: &Server, model: &str, version: i64) -> Vec<u8> {
    let path = format!("/v1/models/{model}/versions/{version}/artifact?format=safetensors");
    download(server, &path).await.1
}

async fn version(server: &Server, model: &str, version: i64) -> Value {
    server.get(&format!("/v1/models/{model}/versions/{version}")).await.expect(200).body
}

async fn assert_sound(server: Server) {
    let directory = server.stop().await;
    let found = verify(&directory.path().join("headway.db"), &|_| {}).await.unwrap();
    assert!(found.faults.is_empty(), "{:?}", found.faults);
}

/// A header of this file with other metadata, and what is behind it.
fn with_metadata(file: &[u8], metadata: &Value) -> Vec<u8> {
    let (length, rest) = file.split_first_chunk::<8>().unwrap();
    let (text, data) = rest.split_at(usize::try_from(u64::from_le_bytes(*length)).unwrap());
    let mut members: Map<String, Value> = serde_json::from_slice(text).unwrap();
    members.insert("__metadata__".to_owned(), metadata.clone());
    let header = Value::Object(members).to_string();
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

#[tokio::test]
async fn what_learns_on_elsewhere_comes_to_the_same_bits_as_without_the_detour() {
    let (here, there) = (Server::start().await, Server::start().await);
    for (model, method, settings) in [
        ("naive", "naive", json!({})),
        ("ewc", "ewc", json!({})),
        ("online", "ewc", json!({"accumulation": "online", "online_decay": 0.7})),
        ("sum", "mas", json!({"accumulation": "sum_latest", "preset": "paper", "hidden": 6, "epochs": 1})),
        ("mas", "mas", json!({})),
        ("si", "si", json!({})),
    ] {
        let new = json!({"model": model, "method": method, "settings": settings});
        for server in [&here, &there] {
            server.post("/v1/models", &new).await.expect(201);
        }
        here.learn(model, "fast", &events("e", 16, 16.0)).await;
        here.learn(model, "slow", &events("f", 16, 6.0)).await;
        let file = file(&here, model, 2).await;
        let imported = import(&there, model, &file).await.expect(201);
        assert_eq!(imported.header("location"), format!("/v1/models/{model}/versions/1"));
        let (before, after) = (version(&here, model, 2).await, version(&there, model, 1).await);
        for same in [
            "stage",
            "regime",
            "settings",
            "strength",
            "lambda",
            "weights_sha256",
            "events",
            "events_sha256",
            "kernel",
            "scaling",
            "importance",
        ] {
            assert_eq!(before[same], after[same], "{same} of {model}");
        }
        assert_eq!((&after["parent"], &after["task_id"]), (&json!(null), &json!(null)));
        here.learn(model, "jam", &events("g", 16, 3.0)).await;
        there.learn(model, "jam", &events("g", 16, 3.0)).await;
        let (before, after) = (version(&here, model, 3).await, version(&there, model, 2).await);
        assert_eq!(before["weights_sha256"], after["weights_sha256"], "{model}");
        assert_eq!((&after["stage"], &after["parent"]), (&json!(3), &json!(1)));
        let evaluation = there.get(&format!("/v1/models/{model}/versions/2/evaluation")).await.expect(200);
        let tasks = evaluation["tasks"].as_array().unwrap();
        let names: Vec<_> = tasks.iter().map(|task| task["regime"].as_str().unwrap()).collect();
        assert_eq!(names, ["fast", "slow", "jam"]);
        assert_eq!((&tasks[0]["events"], &tasks[1]["spacing_mse"]), (&json!(0), &json!(null)));
        assert_eq!(tasks[2]["events"], 4);
        assert!(tasks[2]["before"].is_number(), "{}", evaluation.text);
    }
    assert_sound(there).await;
    here.stop().await;
}

#[tokio::test]
async fn a_version_that_was_brought_serves_by_the_policy_and_sets_aside_what_it_does_not_continue() {
    let server = Server::start_with("[model]\npromotion = \"gated\"").await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    let file = file(&server, "default", 1).await;
    let kept = import(&server, "default", &file).await.expect(201);
    assert_eq!((&kept["version"], &kept["promotion"]["decision"]), (&json!(2), &json!("kept")));
    let reason = kept["promotion"]["reason"].as_str().unwrap();
    assert!(reason.starts_with("imported: version 1 of default") && reason.contains("no test events"), "{reason}");
    let model = server.get("/v1/models/default").await.expect(200);
    assert_eq!((&model["live"], &model["head"]), (&json!(1), &json!(2)));
    assert_eq!(server.get("/v1/models/default/batches/b1").await["events"]["set_aside"], 16);
    server.post("/v1/models", &json!({"model": "new", "method": "ewc"})).await.expect(201);
    let live = import(&server, "new", &file).await.expect(201);
    assert_eq!(live["promotion"]["decision"], "promoted");
    let windows = json!({"windows": [window(5, 9.0)]});
    let answers = ["default", "new"].map(|model| format!("/v1/models/{model}/predict"));
    let [before, after] =
        [server.post(&answers[0], &windows).await.expect(200), server.post(&answers[1], &windows).await.expect(200)];
    assert_eq!(before["predictions"], after["predictions"]);
    let history = server.get("/v1/models/new/history").await.expect(200);
    assert_eq!((&history["history"][0]["live"], &history["history"][0]["action"]), (&json!(1), &json!("policy")));
    let audit = server.get("/v1/audit?model=new").await.expect(200);
    let made = audit["audit"].as_array().unwrap().iter().find(|entry| entry["action"] == "version.create");
    assert_eq!(made.unwrap()["actor"], "local");
    server.post("/v1/models/default/rollback", &json!({"version": 1, "reason": "a test"})).await.expect(200);
    assert_sound(server).await;
}

#[tokio::test]
async fn a_network_of_torch_is_continued_without_an_anchor_for_what_it_knew() {
    let server = Server::start().await;
    let paper = json!({"preset": "paper", "hidden": 6, "horizon": 5, "epochs": 1});
    server.post("/v1/models", &json!({"model": "torch", "method": "ewc", "settings": paper})).await.expect(201);
    server.learn("torch", "fast", &events("e", 16, 16.0)).await;
    server.post("/v1/models", &json!({"model": "naive", "method": "naive", "settings": paper})).await.expect(201);
    let file = file(&server, "torch", 1).await;
    // What torch would save: no regimes, and nothing of ours in the metadata.
    let (length, rest) = file.split_first_chunk::<8>().unwrap();
    let (text, data) = rest.split_at(usize::try_from(u64::from_le_bytes(*length)).unwrap());
    let mut members: Map<String, Value> = serde_json::from_slice(text).unwrap();
    let scaling = members["__metadata__"]["scaling"].clone();
    members.retain(|name, _| !name.starts_with("regimes."));
    let end = members.values().filter_map(|entry| entry["data_offsets"][1].as_u64()).max().unwrap();
    members["__metadata__"] = json!({"scaling": scaling, "accel_limit_mps2": "4"});
    let header = Value::Object(members).to_string();
    let data = &data[..usize::try_from(end).unwrap()];
    let network = [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat();
    for model in ["torch", "naive"] {
        let imported = import(&server, model, &network).await.expect(201);
        assert_eq!((&imported["stage"], &imported["regime"]), (&json!(1), &json!("default")));
        assert_eq!((&imported["importance"], &imported["events"]), (&json!(null), &json!(0)));
        server.learn(model, "slow", &events("f", 16, 6.0)).await;
    }
    let hash = async |path: &str| server.get(path).await.expect(200)["weights_sha256"].clone();
    let naive = hash("/v1/models/naive/versions/2").await;
    assert_eq!(hash("/v1/models/torch/versions/3").await, naive, "nothing is known that could hold it");
    let bare = with_metadata(&network, &json!({}));
    let refused = import(&server, "torch", &bare).await.expect_problem(422, "invalid_body");
    assert_eq!(refused["errors"][0]["pointer"], "/__metadata__/scaling");
    assert!(refused["detail"].as_str().unwrap().contains("\"mean\""), "{}", refused.text);
    assert_sound(server).await;
}

#[tokio::test]
async fn a_file_is_refused_for_what_it_is_or_when_the_model_cannot_take_it() {
    let server = Server::start_with("[server]\nartifact_bytes = 100_000").await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    let file = file(&server, "default", 1).await;
    import(&server, "default", b"no file").await.expect_problem(400, "malformed_body");
    import(&server, "default", &file[..file.len() - 1]).await.expect_problem(400, "malformed_body");
    import(&server, "default", &vec![0; 100_001]).await.expect_problem(413, "body_too_large");
    import(&server, "absent", &file).await.expect_problem(404, "model_not_found");
    for method in ["joint", "replay", "replay_ewc"] {
        server.post("/v1/models", &json!({"model": method, "method": method})).await.expect(201);
        import(&server, method, &file).await.expect_problem(409, "method_needs_events");
    }
    server.post("/v1/models", &json!({"model": "mas", "method": "mas"})).await.expect(201);
    let other = import(&server, "mas", &file).await.expect_problem(422, "invalid_body");
    assert_eq!(other["errors"][0]["pointer"], "/__metadata__/method");
    let wide = json!({"model": "wide", "method": "ewc", "settings": {"hidden": 7}});
    server.post("/v1/models", &wide).await.expect(201);
    let other = import(&server, "wide", &file).await.expect_problem(422, "invalid_body");
    assert_eq!(other["errors"][0]["pointer"], "/__metadata__/settings/hidden");
    let path = "/v1/models/default/versions";
    let typed = |kind: &str| server.request(Method::POST, path).header(CONTENT_TYPE, kind).body(file.clone());
    server.send(typed("application/json")).await.expect_problem(415, "unsupported_media_type");
    let zipped = typed(OCTETS).header("content-encoding", "gzip");
    server.send(zipped).await.expect_problem(415, "unsupported_media_type");
    server.send(typed("application/vnd.safetensors")).await.expect(201);
    server.post("/v1/models/default/pause", &json!({})).await.expect(200);
    server.upload("default", "", &events("f", 8, 6.0)).await.expect(201);
    server.post("/v1/models/default/tasks", &json!({"batches": "pending"})).await.expect(202);
    import(&server, "default", &file).await.expect_problem(409, "tasks_under_way");
    assert_eq!(server.get(path).await["versions"].as_array().unwrap().len(), 2);
    server.stop().await;
}

#[tokio::test]
async fn a_file_that_is_sent_again_with_its_key_makes_one_version() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    let file = file(&server, "default", 1).await;
    let send = |body: Vec<u8>| {
        let request = server.request(Method::POST, "/v1/models/default/versions").header(CONTENT_TYPE, OCTETS);
        server.send(request.header("idempotency-key", "a key").body(body))
    };
    let first = send(file.clone()).await.expect(201);
    let second = send(file).await.expect(201);
    assert_eq!((&first.body, second.header("idempotency-replayed")), (&second.body, "true"));
    send(b"another".to_vec()).await.expect_problem(422, "idempotency_mismatch");
    assert_eq!(server.get("/v1/models/default/versions").await["versions"].as_array().unwrap().len(), 2);
    server.stop().await;
}

#[tokio::test]
async fn a_line_that_came_from_elsewhere_is_held_to_what_it_brought() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    server.learn("default", "slow", &events("f", 16, 6.0)).await;
    let file = file(&server, "default", 2).await;
    import(&server, "default", &file).await.expect(201);
    server.learn("default", "jam", &events("g", 16, 3.0)).await;
    let database = server.directory.path().join("headway.db");
    execute(&database, "update version_regime set learned_stage = 1 where version = 4 and regime = 'slow'").await;
    let directory = server.stop().await;
    let found = verify(&directory.path().join("headway.db"), &|_| {}).await.unwrap();
    let places: Vec<_> = found.faults.iter().filter(|fault| fault.check == "evaluations").collect();
    assert_eq!(places.len(), 1, "{:?}", found.faults);
    assert!(places[0].place.contains("version 4, regime slow"), "{places:?}");
}

#[tokio::test]
async fn what_was_learned_behind_a_version_that_was_brought_can_be_unlearned() {
    let server = Server::start().await;
    server.learn("default", "fast", &events("e", 16, 16.0)).await;
    let file = file(&server, "default", 1).await;
    for model in ["moved", "direct"] {
        server.post("/v1/models", &json!({"model": model, "method": "ewc"})).await.expect(201);
        import(&server, model, &file).await.expect(201);
    }
    server.learn("moved", "slow", &events("f", 16, 6.0)).await;
    server.learn("moved", "jam", &events("g", 16, 3.0)).await;
    let batches = server.get("/v1/models/moved/batches").await.expect(200);
    let slow = batches["batches"][0]["batch_id"].as_str().unwrap();
    let retract = server.request(Method::DELETE, &format!("/v1/models/moved/batches/{slow}"));
    let replay = server.send(retract).await.expect(202);
    let ended = server.end_of("moved", replay["task_id"].as_str().unwrap()).await;
    assert_eq!(ended["state"], "succeeded", "{}", ended.text);
    server.learn("direct", "jam", &events("g", 16, 3.0)).await;
    let (again, direct) = (version(&server, "moved", 4).await, version(&server, "direct", 2).await);
    assert_eq!((&again["stage"], &again["parent"]), (&json!(2), &json!(1)));
    assert_eq!(again["weights_sha256"], direct["weights_sha256"]);
    assert_sound(server).await;
}
