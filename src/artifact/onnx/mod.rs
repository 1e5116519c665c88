//! A version as an ONNX graph: windows in, the network's accelerations out, scaling and limit inside.

mod graph;
mod messages;

#[cfg(test)]
mod evaluator;
#[cfg(test)]
mod tests;

use prost::Message;

use crate::driver::{DriverShape, Scaling};
use messages::{ModelProto, OperatorSet, Property};

/// The version of ONNX's operators that the graph is written in.
const OPSET: i64 = 17;
/// The version of the file's own format that came with it.
const IR_VERSION: i64 = 8;

/// What is said in a graph of where it is from.
#[derive(Debug, Clone, Copy)]
pub struct OnnxNames<'a> {
    /// The model.
    pub model: &'a str,
    /// Its version.
    pub version: i64,
    /// Digest of the flat weights, hex.
    pub weights_sha256: &'a str,
}

/// The file: input `window`, FP32 `[n, horizon, 4]` (follower speed, leader speed, relative speed in m/s, spacing in m; oldest
/// step first), output `raw_accel_mps2`, FP32 `[n, 1]`, in m/s². n is free.
///
/// It computes what [`Driver::accelerations`](crate::driver::Driver::accelerations) does: with carried memory too, whose state
/// is warmed on the window. The envelope is no part of it.
///
/// # Panics
/// When there are not as many weights as the shape has.
#[must_use]
pub fn onnx(shape: DriverShape, scaling: &Scaling, weights: &[f32], names: &OnnxNames<'_>) -> Vec<u8> {
    let property = |key: &str, value: String| Property { key: Some(key.to_owned()), value: Some(value) };
    let OnnxNames { model, version, weights_sha256 } = names;
    let file = ModelProto {
        ir_version: Some(IR_VERSION),
        opset_import: vec![OperatorSet { domain: Some(String::new()), version: Some(OPSET) }],
        producer_name: Some("headway".to_owned()),
        producer_version: Some(env!("CARGO_PKG_VERSION").to_owned()),
        model_version: Some(*version),
        doc_string: Some(format!(
            "Car-following model {model}, version {version}. Input window: [n, {}, 4], steps of {} s, oldest first: follower \
             speed, leader speed, leader minus follower speed (m/s), spacing bumper to bumper (m). Output raw_accel_mps2: \
             the network's acceleration of the follower (m/s2), within {} either way. What a server answers as accel_mps2 \
             is bounded by its envelope besides, which is no part of this graph.",
            shape.horizon, shape.dt_s, shape.accel_limit_mps2
        )),
        graph: Some(graph::graph(shape, scaling, weights)),
        metadata_props: vec![
            property("model", (*model).to_owned()),
            property("version", version.to_string()),
            property("weights_sha256", (*weights_sha256).to_owned()),
            property("horizon", shape.horizon.to_string()),
            property("dt_s", shape.dt_s.to_string()),
            property("accel_limit_mps2", shape.accel_limit_mps2.to_string()),
        ],
    };
    file.encode_to_vec()
}
