//! Seeds that are bodies of the inference protocol, behind the length of their JSON.

use serde_json::{Value, json};

/// Said to be nothing but JSON.
fn plain(body: &str) -> Vec<u8> {
    [&u16::MAX.to_le_bytes()[..], body.as_bytes()].concat()
}

/// JSON, and bytes behind it.
fn with_bytes(header: &Value, tail: &[u8]) -> Vec<u8> {
    let header = header.to_string();
    let length = u16::try_from(header.len()).unwrap();
    [&length.to_le_bytes()[..], header.as_bytes(), tail].concat()
}

pub(super) fn bodies() -> Vec<(&'static str, Vec<u8>)> {
    let tensor = |name: &str, shape: &[u64], data: Value| json!({"name": name, "datatype": "FP32", "shape": shape, "data": data});
    let window = || tensor("window", &[1, 5, 4], json!(vec![9.5; 20]));
    let sent = |size: u64| json!({"name": "window", "datatype": "FP32", "shape": [1, 5, 4], "parameters": {"binary_data_size": size}});
    let step = |parameters: Value| {
        json!({"parameters": parameters, "inputs": [tensor("step", &[1, 4], json!([14, 15, 1, 20]))]}).to_string()
    };
    let numbers = |number: f32| number.to_le_bytes().repeat(20);
    let json = |body: Value| plain(&body.to_string());
    vec![
        ("flat", json(json!({"id": "a", "inputs": [window()]}))),
        ("nested", json(json!({"inputs": [tensor("window", &[1, 5, 4], json!([vec![[14, 15, 1, 20]; 5]]))]}))),
        ("deep", json(json!({"inputs": [tensor("window", &[1, 5, 4], json!([[[[[1]]]]]))]}))),
        (
            "outputs",
            json(
                json!({"inputs": [window()], "outputs": [{"name": "accel_mps2", "parameters": {"binary_data": true}}]}),
            ),
        ),
        ("strange-output", json(json!({"inputs": [window()], "outputs": [{"name": "x"}]}))),
        (
            "class",
            json(
                json!({"inputs": [window()], "outputs": [{"name": "accel_mps2", "parameters": {"classification": 3}}]}),
            ),
        ),
        (
            "bytes",
            with_bytes(&json!({"inputs": [sent(80)], "parameters": {"binary_data_output": true}}), &numbers(9.5)),
        ),
        ("bytes-nan", with_bytes(&json!({"inputs": [sent(80)]}), &numbers(f32::NAN))),
        ("bytes-few", with_bytes(&json!({"inputs": [sent(80)]}), &[0; 79])),
        ("bytes-odd", with_bytes(&json!({"inputs": [sent(79)]}), &[0; 79])),
        ("bytes-more", with_bytes(&json!({"inputs": [sent(80)]}), &[0; 81])),
        ("bytes-huge", with_bytes(&json!({"inputs": [sent(u64::MAX)]}), &[0; 80])),
        (
            "both",
            with_bytes(
                &json!({"inputs": [{"name": "window", "datatype": "FP32", "shape": [1], "data": [1], "parameters": {"binary_data_size": 4}}]}),
                &[0; 4],
            ),
        ),
        ("header-beyond", [&[255, 127][..], b"{}"].concat()),
        ("step", plain(&step(json!({"sequence_id": 7, "sequence_start": true})))),
        (
            "step-by-name",
            plain(&step(json!({"sequence_id": "bus-12", "sequence_end": true, "sequence_follow_live": true}))),
        ),
        ("step-long-name", plain(&step(json!({"sequence_id": "x".repeat(129)})))),
        ("step-alone", plain(&step(json!({})))),
        ("window-of-sequence", json(json!({"parameters": {"sequence_id": 7}, "inputs": [window()]}))),
        ("shape", json(json!({"inputs": [tensor("window", &[u64::MAX, u64::MAX, 4], json!([1]))]}))),
        ("wide", json(json!({"inputs": [tensor("window", &[1, 20], json!(vec![1; 20]))]}))),
        ("doubles", json(json!({"inputs": [{"name": "window", "datatype": "FP64", "shape": [1, 5, 4], "data": []}]}))),
        (
            "shared",
            json(
                json!({"inputs": [{"name": "window", "datatype": "FP32", "shape": [1, 5, 4], "parameters": {"shared_memory_region": "r"}}]}),
            ),
        ),
        ("absurd", json(json!({"inputs": [tensor("window", &[1], json!([1e300]))]}))),
        ("two", json(json!({"inputs": [window(), window()]}))),
        ("none", json(json!({"inputs": []}))),
        ("unknown", json(json!({"inputs": [tensor("speed", &[1], json!([1]))]}))),
        ("more", plain("{\"inputs\": []} x")),
        ("cut", plain("{\"inputs\": [{\"data\": [1, ")),
    ]
}
