use std::io::Write;

use reqwest::Method;
use serde_json::{Value, json};

use crate::support::events::{events, window};
use crate::support::server::{Answer, Server};

/// Steps of a window, as the tests' models have them.
pub(crate) const HORIZON: usize = 5;

/// A server whose model `default` has learned once, or twice.
pub(crate) async fn learned(stages: usize) -> Server {
    let server = Server::start().await;
    for (regime, speed) in [("fast", 14.0), ("slow", 6.0)].into_iter().take(stages) {
        server.learn("default", regime, &events(regime, 12, speed)).await;
    }
    server
}

/// Rows of windows around some speeds: follower speed, leader speed, relative speed, spacing.
fn rows(speeds: &[f32]) -> Vec<f32> {
    let row = |speed: f32| [speed, speed + 0.5, 0.5, 26.0 + speed / 16.0];
    speeds.iter().flat_map(|&speed| (0..HORIZON).flat_map(move |step| row(speed + step as f32 / 4.0))).collect()
}

/// The same windows as the native interface takes them.
fn native(rows: &[f32]) -> Value {
    let column = |window: &[f32], at: usize| window.iter().skip(at).step_by(4).copied().collect::<Vec<_>>();
    let windows = rows.chunks_exact(4 * HORIZON).map(|window| {
        json!({"follower_speed_mps": column(window, 0), "leader_speed_mps": column(window, 1), "spacing_m": column(window, 3)})
    });
    json!({"windows": windows.collect::<Vec<_>>()})
}

fn tensor(rows: &[f32]) -> Value {
    json!({"name": "window", "datatype": "FP32", "shape": [rows.len() / 4 / HORIZON, HORIZON, 4], "data": rows})
}

async fn infer(server: &Server, body: &Value) -> Answer {
    server.post("/v2/models/default/infer", body).await
}

/// JSON and, behind it, bytes; so are they answered.
async fn infer_bytes(server: &Server, header: &Value, tail: &[u8]) -> (Value, Vec<u8>) {
    let header = header.to_string().into_bytes();
    let request = server
        .request(Method::POST, "/v2/models/default/infer")
        .header("inference-header-content-length", header.len())
        .body([&header, tail].concat());
    let answer = request.send().await.unwrap();
    assert_eq!(answer.status(), 200);
    assert_eq!(answer.headers()["content-type"], "application/octet-stream");
    let length: usize = answer.headers()["inference-header-content-length"].to_str().unwrap().parse().unwrap();
    let body = answer.bytes().await.unwrap();
    (serde_json::from_slice(&body[..length]).unwrap(), body[length..].to_vec())
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().copied().map(f32::from_le_bytes).collect()
}

fn data(answer: &Value, at: usize) -> Vec<f32> {
    serde_json::from_value(answer["outputs"][at]["data"].clone()).unwrap()
}

#[tokio::test]
async fn the_protocol_says_what_there_is() {
    let server = learned(2).await;
    let told = server.get("/v2").await.expect(200);
    assert_eq!(told["name"], "headway");
    assert!(told["extensions"].as_array().unwrap().contains(&json!("binary_tensor_data")));
    assert_eq!(server.get("/v2/health/live").await.expect(200).body, json!({"live": true}));
    assert_eq!(server.get("/v2/health/ready").await.expect(200).body, json!({"ready": true}));
    let model = server.get("/v2/models/default").await.expect(200);
    assert_eq!(model["versions"], json!(["1", "2"]));
    assert_eq!(model["inputs"][0], json!({"name": "window", "datatype": "FP32", "shape": [-1, HORIZON, 4]}));
    assert_eq!(model["outputs"][1], json!({"name": "raw_accel_mps2", "datatype": "FP32", "shape": [-1, 1]}));
    assert_eq!(server.get("/v2/models/default/versions/1").await.expect(200)["versions"], json!(["1"]));
    let ready = server.get("/v2/models/default/ready").await.expect(200);
    assert_eq!(ready.body, json!({"name": "default", "version": "2", "ready": true}));
    assert_eq!(server.get("/v2/models/default/versions/1/ready").await.expect(200)["version"], "1");
    assert_eq!(server.get("/v2/models/default/config").await.expect(200)["max_batch_size"], 20_000);
    server.get("/v2/models/default/versions/2/config").await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn what_is_inferred_is_what_is_predicted_however_it_is_sent() {
    let server = learned(2).await;
    let rows = rows(&[6.0, 10.0, 14.0]);
    let predicted = server.post("/v1/models/default/predict", &native(&rows)).await.expect(200);
    let of = |member: &str| -> Vec<f32> {
        let predictions = predicted["predictions"].as_array().unwrap().iter();
        predictions.map(|p| serde_json::from_value(p[member].clone()).unwrap()).collect()
    };
    let (served, raw) = (of("accel_mps2"), of("raw_accel_mps2"));
    let flat = infer(&server, &json!({"id": "a-1", "inputs": [tensor(&rows)]})).await.expect(200);
    assert_eq!(
        (&flat["id"], &flat["model_name"], &flat["model_version"]),
        (&json!("a-1"), &json!("default"), &json!("2"))
    );
    assert_eq!((data(&flat.body, 0), data(&flat.body, 1)), (served.clone(), raw.clone()));
    assert_eq!(flat["outputs"][0]["shape"], json!([3, 1]));
    let mut nested = tensor(&rows);
    let steps = rows.chunks(4).collect::<Vec<_>>();
    nested["data"] = json!(steps.chunks(HORIZON).collect::<Vec<_>>());
    nested["shape"] = json!([3.0, HORIZON, 4]);
    let wanted = json!([{"name": "raw_accel_mps2"}]);
    let one = infer(&server, &json!({"inputs": [nested], "outputs": wanted})).await.expect(200);
    assert_eq!((data(&one.body, 0), one["outputs"].as_array().unwrap().len()), (raw.clone(), 1));
    // As bytes, both ways.
    let bytes: Vec<u8> = rows.iter().flat_map(|value| value.to_le_bytes()).collect();
    let mut binary = tensor(&rows);
    binary.as_object_mut().unwrap().remove("data");
    binary["parameters"] = json!({"binary_data_size": bytes.len()});
    let header = json!({"inputs": [binary], "parameters": {"binary_data_output": true}});
    let (told, tail) = infer_bytes(&server, &header, &bytes).await;
    assert_eq!(told["outputs"][0]["parameters"], json!({"binary_data_size": 12}));
    assert_eq!(floats(&tail), [served.clone(), raw.clone()].concat());
    let mixed = json!([{"name": "accel_mps2", "parameters": {"binary_data": false}},
                       {"name": "raw_accel_mps2", "parameters": {"binary_data": true}}]);
    let (told, tail) = infer_bytes(&server, &json!({"inputs": [binary], "outputs": mixed}), &bytes).await;
    assert_eq!((data(&told, 0), floats(&tail)), (served.clone(), raw.clone()));
    // Compressed.
    let body = json!({"inputs": [tensor(&rows)]}).to_string();
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(body.as_bytes()).unwrap();
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    zlib.write_all(body.as_bytes()).unwrap();
    for (encoding, body) in [("gzip", gzip.finish().unwrap()), ("deflate", zlib.finish().unwrap())] {
        let request = server.request(Method::POST, "/v2/models/default/infer").header("content-encoding", encoding);
        assert_eq!(data(&server.send(request.body(body)).await.expect(200).body, 0), served);
    }
    // A version by its number.
    let mut wish = native(&rows);
    wish["version"] = json!(1);
    let first = server.post("/v1/models/default/predict", &wish).await.expect(200);
    let named =
        server.post("/v2/models/default/versions/1/infer", &json!({"inputs": [tensor(&rows)]})).await.expect(200);
    assert_eq!(named["model_version"], "1");
    assert_eq!(named["outputs"][0]["data"][2], first["predictions"][2]["accel_mps2"]);
    assert_ne!(data(&named.body, 1), raw);
    server.stop().await;
}

#[tokio::test]
async fn a_large_request_is_split_and_answered_the_same() {
    let server = learned(1).await;
    let rows = rows(&(0..300).map(|n| 5.0 + n as f32 / 30.0).collect::<Vec<_>>());
    let predicted = server.post("/v1/models/default/predict", &native(&rows)).await.expect(200);
    let inferred = infer(&server, &json!({"inputs": [tensor(&rows)]})).await.expect(200);
    let expected: Vec<_> =
        predicted["predictions"].as_array().unwrap().iter().map(|p| p["accel_mps2"].clone()).collect();
    assert_eq!(inferred["outputs"][0]["data"], json!(expected));
    server.stop().await;
}

#[tokio::test]
async fn flags_and_a_relative_speed_that_is_none_are_told() {
    let server = learned(1).await;
    let mut rows = rows(&[13.0]);
    assert_eq!(infer(&server, &json!({"inputs": [tensor(&rows)]})).await.expect(200)["parameters"], Value::Null);
    rows[2] += 3.0;
    rows[3] = 9000.0;
    let told = infer(&server, &json!({"inputs": [tensor(&rows)]})).await.expect(200)["parameters"].clone();
    assert_eq!(told, json!({"flags": "out_of_range", "out_of_range": true, "rel_speed_differs": true}));
    server.stop().await;
}

#[tokio::test]
async fn every_refusal_is_an_error_of_the_protocol() {
    let server = learned(1).await;
    let refused = async |status: u16, inputs: Value, says: &str| {
        let answer = infer(&server, &json!({"inputs": inputs})).await.expect(status);
        let error = answer["error"].as_str().unwrap();
        assert!(error.contains(says), "{error}");
    };
    let good = tensor(&rows(&[14.0]));
    let with = |member: &str, value: Value| {
        let mut tensor = good.clone();
        tensor[member] = value;
        json!([tensor])
    };
    refused(422, json!([]), "one input").await;
    refused(422, json!([good, good]), "one input").await;
    refused(422, with("name", json!("speed")), "window is taken").await;
    refused(422, with("name", json!("step")), "sequence_id says which").await;
    refused(422, with("datatype", json!("FP64")), "FP32 is taken").await;
    refused(422, with("shape", json!([1, HORIZON, 3])), "20 elements").await;
    refused(422, with("shape", json!([HORIZON, 4])), "[n, horizon, 4]").await;
    refused(422, with("shape", json!([2, HORIZON, 4])), "20 elements").await;
    refused(422, with("shape", json!([1_u64 << 52, 1_u64 << 52, 4])), "20 elements").await;
    refused(422, with("shape", json!([-1, HORIZON, 4])), "below 0").await;
    refused(422, with("shape", json!([5, 1, 4])), "exactly the last 5").await;
    refused(422, with("data", json!(vec![1e7; 20])), "not within").await;
    refused(422, with("data", json!(["a"])), "numbers").await;
    refused(422, with("parameters", json!({"binary_data_size": 80})), "either data or").await;
    refused(422, with("parameters", json!({"shared_memory_region": "r"})), "not shared").await;
    let wanted = |output: Value| json!({"inputs": [good], "outputs": [output]});
    infer(&server, &wanted(json!({"name": "speed"}))).await.expect(422);
    infer(&server, &wanted(json!({"name": "accel_mps2", "parameters": {"classification": 2}}))).await.expect(422);
    infer(&server, &wanted(json!({"name": "accel_mps2", "parameters": {"shared_memory_region": "r"}})))
        .await
        .expect(422);
    let raw = |name: &'static str, value: &'static str, body: Vec<u8>| {
        let request = server.request(Method::POST, "/v2/models/default/infer").header(name, value);
        server.send(request.body(body))
    };
    let body = || json!({"inputs": [good]}).to_string().into_bytes();
    raw("inference-header-content-length", "9999999", body()).await.expect(400);
    raw("inference-header-content-length", "-1", body()).await.expect(400);
    raw("inference-header-content-length", "4", body()).await.expect(400);
    raw("content-encoding", "br", body()).await.expect(415);
    raw("content-encoding", "gzip", body()).await.expect(400);
    raw("x-nothing", "", [body(), b"tail".to_vec()].concat()).await.expect(400);
    let bytes = json!({"inputs": [{"name": "window", "datatype": "FP32", "shape": [1, HORIZON, 4],
                                   "parameters": {"binary_data_size": 80}}]});
    let short = server
        .request(Method::POST, "/v2/models/default/infer")
        .header("inference-header-content-length", bytes.to_string().len());
    server.send(short.body(bytes.to_string() + "too few")).await.expect(422);
    // Whatever is wrong, and wherever.
    for (path, status) in [
        ("/v2/models/nobody", 404),
        ("/v2/models/default/versions/9", 404),
        ("/v2/models/default/versions/x/ready", 404),
        ("/v2/models/%ff", 404),
        ("/v2/nothing", 404),
    ] {
        assert!(server.get(path).await.expect(status)["error"].is_string(), "{path}");
    }
    let deleted = server.send(server.request(Method::DELETE, "/v2/models/default")).await.expect(405);
    assert!(deleted["error"].as_str().unwrap().contains("method_not_allowed"));
    server.post("/v1/models", &json!({"model": "empty", "method": "naive"})).await.expect(201);
    let empty = server.get("/v2/models/empty/ready").await.expect(409);
    assert!(empty["error"].as_str().unwrap().contains("no_live_version"));
    server.stop().await;
}

#[tokio::test]
async fn keys_limit_what_the_protocol_shows() {
    let mut server = learned(1).await;
    server.post("/v1/models", &json!({"model": "other", "method": "naive"})).await.expect(201);
    server.close_gate().await;
    let limited = server.make_key(&json!({"scopes": ["predict"], "models": ["other"]})).await;
    server.key = None;
    assert!(server.get("/v2/models/default").await.expect(401)["error"].as_str().unwrap().contains("A key is needed"));
    server.key = Some(limited);
    server.get("/v2/models/default").await.expect(403);
    server.get("/v2/models/stats").await.expect(403);
    let index = server.post("/v2/repository/index", &json!({})).await.expect(200);
    assert_eq!(
        index.body,
        json!([{"name": "other", "version": "", "state": "UNAVAILABLE", "reason": "nothing is live"}])
    );
    server.post("/v2/repository/models/other/unload", &json!({})).await.expect(403);
    server.stop().await;
}

#[tokio::test]
async fn a_model_that_is_unloaded_is_answered_for_by_the_native_interface_alone() {
    let server = learned(1).await;
    let entry =
        |state: &str, reason: &str| json!([{"name": "default", "version": "1", "state": state, "reason": reason}]);
    let index = async |wish: &Value| server.post("/v2/repository/index", wish).await.expect(200).body;
    assert_eq!(index(&json!({})).await, entry("READY", ""));
    server.post("/v2/repository/models/default/unload", &json!({"parameters": {}})).await.expect(200);
    assert_eq!(index(&json!({})).await, entry("UNAVAILABLE", "unloaded"));
    assert_eq!(index(&json!({"ready": true})).await, json!([]));
    server.get("/v2/models/default/ready").await.expect(503);
    infer(&server, &json!({"inputs": [tensor(&rows(&[14.0]))]})).await.expect(503);
    let wish = json!({"windows": [window(HORIZON, 14.0)]});
    server.post("/v1/models/default/predict", &wish).await.expect(200);
    server.send(server.request(Method::POST, "/v2/repository/models/default/load")).await.expect(200);
    server.get("/v2/models/default/ready").await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn statistics_count_what_was_asked_of_each_version() {
    let server = learned(2).await;
    let never = server.get("/v2/models/default/versions/1/stats").await.expect(200)["model_stats"][0].clone();
    assert_eq!((&never["inference_count"], &never["last_inference"]), (&json!(0), &json!(0)));
    for _ in 0..3 {
        infer(&server, &json!({"inputs": [tensor(&rows(&[14.0, 10.0]))]})).await.expect(200);
    }
    let mut wrong = tensor(&rows(&[14.0]));
    wrong["shape"] = json!([5, 1, 4]);
    infer(&server, &json!({"inputs": [wrong]})).await.expect(422);
    let stats = server.get("/v2/models/default/stats").await.expect(200)["model_stats"].clone();
    assert_eq!(stats.as_array().unwrap().len(), 1);
    let of = &stats[0];
    assert_eq!((&of["version"], &of["inference_count"], &of["execution_count"]), (&json!("2"), &json!(6), &json!(3)));
    let times = &of["inference_stats"];
    assert_eq!((&times["success"]["count"], &times["fail"]["count"]), (&json!(3), &json!(1)));
    let ns = |part: &str| times[part]["ns"].as_u64().unwrap();
    assert!(ns("compute_infer") > 0);
    assert_eq!(ns("success"), ns("compute_input") + ns("compute_infer") + ns("compute_output"));
    assert_eq!(server.get("/v2/models/stats").await.expect(200)["model_stats"], stats);
    server.stop().await;
}
