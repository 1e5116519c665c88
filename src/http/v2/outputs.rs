//! What is answered: JSON, and behind it the outputs that are asked for as bytes.

use axum::http::Response;
use axum::http::header::CONTENT_TYPE;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::metadata::OUTPUTS;
use super::request::{HEADER_LENGTH, Request};
use super::tensor::Elements;
use crate::predictor::{Flag, Prediction};

/// The JSON of an answer.
#[derive(Debug, Serialize)]
struct Body<'a> {
    model_name: &'a str,
    model_version: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    id: Option<&'a str>,
    #[serde(skip_serializing_if = "Map::is_empty")]
    parameters: Map<String, Value>,
    outputs: Vec<Output<'a>>,
}

/// An output: its elements, or how many bytes of them come behind.
#[derive(Debug, Serialize)]
struct Output<'a> {
    name: &'a str,
    datatype: &'static str,
    shape: [usize; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    data: Option<Vec<f32>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    parameters: Option<Sent>,
}

#[derive(Debug, Serialize)]
struct Sent {
    binary_data_size: usize,
}

/// The answer of a version.
pub(super) fn answer(
    model: &str,
    version: i64,
    request: &Request,
    predictions: &[Prediction],
    rel_speed_differs: bool,
) -> Response<axum::body::Body> {
    let mut tail = Vec::new();
    let all = || OUTPUTS.iter().map(|&name| (name, None)).collect();
    let wanted = request.outputs.as_ref().filter(|outputs| !outputs.is_empty());
    let wanted: Vec<_> = wanted.map_or_else(all, |outputs| {
        outputs.iter().map(|output| (output.name.as_str(), output.parameters.binary_data)).collect()
    });
    let mut output = |(name, binary): (_, Option<bool>)| {
        let elements = elements(name, predictions);
        let shape = [elements.len(), 1];
        let (data, parameters) = if binary.unwrap_or(request.binary) {
            let bytes = Elements::to_bytes(&elements);
            let sent = Sent { binary_data_size: bytes.len() };
            tail.extend(bytes);
            (None, Some(sent))
        } else {
            (Some(elements), None)
        };
        Output { name, datatype: "FP32", shape, data, parameters }
    };
    let body = Body {
        model_name: model,
        model_version: version.to_string(),
        id: request.id.as_deref(),
        parameters: parameters(predictions, rel_speed_differs),
        outputs: wanted.into_iter().map(&mut output).collect(),
    };
    let mut bytes = serde_json::to_vec(&body).expect("an answer is plain data");
    let answer = Response::builder();
    let answer = if tail.is_empty() {
        answer.header(CONTENT_TYPE, "application/json")
    } else {
        answer.header(CONTENT_TYPE, "application/octet-stream").header(HEADER_LENGTH, bytes.len())
    };
    bytes.append(&mut tail);
    answer.body(bytes.into()).expect("headers of this crate")
}

fn elements(name: &str, predictions: &[Prediction]) -> Vec<f32> {
    let served = name == OUTPUTS[0];
    predictions.iter().map(|answer| if served { answer.accel_mps2 } else { answer.raw_accel_mps2 }).collect()
}

/// Flags that some answer carries: each by its name, and all their names together.
fn parameters(predictions: &[Prediction], rel_speed_differs: bool) -> Map<String, Value> {
    let carried = |flag: &Flag| predictions.iter().any(|prediction| prediction.flags.contains(flag));
    let names: Vec<_> = Flag::ALL.iter().filter(|flag| carried(flag)).map(|flag| flag.as_str()).collect();
    let mut parameters: Map<_, _> = names.iter().map(|&name| (name.to_owned(), json!(true))).collect();
    if !names.is_empty() {
        parameters.insert("flags".to_owned(), json!(names.join(",")));
    }
    if rel_speed_differs {
        parameters.insert("rel_speed_differs".to_owned(), json!(true));
    }
    parameters
}
