use prost::Message;

use super::evaluator::{Values, evaluate};
use super::graph::in_onnx_order;
use super::messages::{Graph, ModelProto};
use super::{OnnxNames, onnx};
use crate::driver::{Driver, DriverShape, Features, Memory, MotionScaling, Scaling, Window};
use crate::lstm::initial_weights;

const SCALING: Scaling =
    Scaling { mean: [8.0, 8.5, 0.3, 14.0], spread: [3.0, 3.5, 1.2, 5.0], low: [0.0; 4], high: [30.0; 4], motion: None };

/// Weights that differ from each other by much, so that none is taken for another.
fn weights(shape: DriverShape) -> Vec<f32> {
    initial_weights(shape.layout(), 7)
        .iter()
        .enumerate()
        .map(|(i, w)| 2.0 * w + 0.01 * ((i % 7) as f32 - 3.0))
        .collect()
}

fn windows(shape: DriverShape) -> Vec<Window> {
    let window = |k: usize| {
        let wave = |t: usize, by: f32| (0.4 * t as f32 + by + k as f32).sin();
        Window {
            follower_speed_mps: (0..shape.horizon).map(|t| 8.0 + 3.0 * wave(t, 0.0)).collect(),
            leader_speed_mps: (0..shape.horizon).map(|t| 8.0 + 4.0 * wave(t, 0.7)).collect(),
            // One has collided.
            spacing_m: (0..shape.horizon).map(|t| 20.0 - 11.0 * k as f32 + wave(t, 2.0)).collect(),
        }
    };
    (0..3).map(window).collect()
}

fn decoded(shape: DriverShape, scaling: &Scaling, weights: &[f32]) -> (ModelProto, Graph) {
    let bytes = onnx(shape, scaling, weights, &OnnxNames { model: "m", version: 3, weights_sha256: "ab" });
    let mut file = ModelProto::decode(&bytes[..]).unwrap();
    let graph = file.graph.take().unwrap();
    (file, graph)
}

fn assert_drives_alike(shape: DriverShape, scaling: &Scaling) {
    let (weights, windows) = (weights(shape), windows(shape));
    let (_, graph) = decoded(shape, scaling, &weights);
    let data = windows.iter().flat_map(|window| {
        (0..shape.horizon).flat_map(|t| {
            let seen = window.seen(t);
            let relative = seen.leader_speed_mps - seen.follower_speed_mps;
            [seen.follower_speed_mps, seen.leader_speed_mps, relative, seen.spacing_m].map(f64::from)
        })
    });
    let input = Values { shape: vec![windows.len(), shape.horizon, 4], data: data.collect() };
    let output = evaluate(&graph, input);
    assert_eq!(output.shape, [windows.len(), 1]);
    let driver = Driver::new(shape, *scaling, weights).unwrap();
    for (onnx, served) in output.data.iter().zip(driver.accelerations(&windows)) {
        assert!((onnx - f64::from(served)).abs() < 1e-5 * f64::from(shape.accel_limit_mps2), "{onnx} {served}");
        assert!(onnx.abs() > 0.01, "an acceleration that tells nothing");
    }
}

#[test]
fn the_graph_by_the_formulas_of_onnx_drives_as_the_driver_does() {
    assert_drives_alike(DriverShape { hidden: 5, horizon: 6, ..DriverShape::PAPER }, &SCALING);
}

#[test]
fn the_inputs_that_are_told_from_the_others_are_in_the_graph() {
    let shape = DriverShape {
        hidden: 5,
        horizon: 6,
        memory: Memory::Carried,
        features: Features::Motion,
        ..DriverShape::PAPER
    };
    let motion = MotionScaling { mean: [0.1, -0.2, 0.05], spread: [0.8, 0.9, 0.2] };
    assert_drives_alike(shape, &Scaling { motion: Some(motion), ..SCALING });
}

#[test]
fn gates_are_put_from_torchs_order_into_onnxs() {
    // Two units of one input: rows i0 i1 f0 f1 g0 g1 o0 o1.
    let torch = [10.0, 11.0, 20.0, 21.0, 30.0, 31.0, 40.0, 41.0];
    assert_eq!(in_onnx_order(&torch, 2), [10.0, 11.0, 40.0, 41.0, 20.0, 21.0, 30.0, 31.0]);
    // One unit of two inputs: a row moves as a whole.
    assert_eq!(in_onnx_order(&torch, 1), [10.0, 11.0, 40.0, 41.0, 20.0, 21.0, 30.0, 31.0]);
}

#[test]
fn the_file_says_what_it_is_and_leaves_the_number_of_windows_open() {
    let shape = DriverShape { hidden: 2, horizon: 3, ..DriverShape::PAPER };
    let (file, graph) = decoded(shape, &SCALING, &weights(shape));
    assert_eq!((file.opset_import[0].version, file.ir_version), (Some(17), Some(8)));
    let properties: Vec<_> =
        file.metadata_props.iter().map(|p| (p.key.as_deref().unwrap(), p.value.as_deref().unwrap())).collect();
    assert_eq!(properties[..3], [("model", "m"), ("version", "3"), ("weights_sha256", "ab")]);
    assert!(file.doc_string.unwrap().contains("envelope"));
    let dims = |info: &super::messages::ValueInfo| {
        let shape = info.kind.clone().unwrap().tensor.unwrap().shape.unwrap();
        shape.dim.into_iter().map(|dim| dim.name.unwrap_or_else(|| dim.size.unwrap().to_string())).collect::<Vec<_>>()
    };
    assert_eq!(
        (dims(&graph.input[0]), dims(&graph.output[0])),
        (vec!["n".into(), "3".into(), "4".into()], vec!["n".into(), "1".into()])
    );
}
