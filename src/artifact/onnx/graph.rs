//! The graph of a driver, operator by operator.

use super::messages::{Attribute, Dimension, Graph, Node, Shape, Tensor, TensorType, Type, ValueInfo};
use crate::driver::{DriverShape, Features, MotionScaling, Scaling};
use crate::lstm::INPUTS;

/// ONNX's names for types of numbers.
pub(super) const FLOAT: i32 = 1;
pub(super) const INT64: i32 = 7;
/// And for kinds of attributes.
const ATTRIBUTE_INT: i32 = 2;
const ATTRIBUTE_INTS: i32 = 7;

const WINDOW: &str = "window";
const RAW_ACCEL: &str = "raw_accel_mps2";

/// Nodes and constants so far.
#[derive(Default)]
struct Builder {
    nodes: Vec<Node>,
    constants: Vec<Tensor>,
}

/// Everything from `window` to `raw_accel_mps2`.
pub(super) fn graph(shape: DriverShape, scaling: &Scaling, weights: &[f32]) -> Graph {
    let (hidden, layout) = (shape.hidden, shape.layout());
    assert_eq!(weights.len(), layout.len(), "the weights of this network");
    let mut built = Builder::default();
    let inputs = match shape.features {
        Features::Raw => WINDOW.to_owned(),
        Features::Motion => built.with_motion(shape),
    };
    let (mean, spread) = standardisation(scaling, shape.features);
    let mean = built.floats("mean", &[mean.len()], &mean);
    let spread = built.floats("spread", &[spread.len()], &spread);
    let centred = built.node("Sub", &[&inputs, &mean], "centred", vec![]);
    let standardised = built.node("Div", &[&centred, &spread], "standardised", vec![]);
    let by_step = built.node("Transpose", &[&standardised], "by_step", vec![ints("perm", &[1, 0, 2])]);
    let gates = |values: &[f32]| in_onnx_order(values, hidden);
    let w = built.floats("W", &[1, 4 * hidden, layout.inputs], &gates(&weights[layout.input()]));
    let r = built.floats("R", &[1, 4 * hidden, hidden], &gates(&weights[layout.recurrent()]));
    // The bias of the inputs, and that of the state: ours is their sum.
    let bias = [gates(&weights[layout.bias()]), vec![0.0; 4 * hidden]].concat();
    let b = built.floats("B", &[1, 8 * hidden], &bias);
    let last = built.lstm(&[&by_step, &w, &r, &b], hidden);
    let axes = built.integers("direction", &[0]);
    let state = built.node("Squeeze", &[&last, &axes], "state", vec![]);
    let head = built.floats("head", &[1, hidden], &weights[layout.head()]);
    let head_bias = built.floats("head_bias", &[1], &weights[layout.head_bias()..]);
    let value = built.node("Gemm", &[&state, &head, &head_bias], "value", vec![int("transB", 1)]);
    let squashed = built.node("Tanh", &[&value], "squashed", vec![]);
    let limit = built.floats("accel_limit_mps2", &[], &[shape.accel_limit_mps2]);
    built.node("Mul", &[&squashed, &limit], RAW_ACCEL, vec![]);
    let steps = Dimension { size: Some(signed(shape.horizon)), name: None };
    Graph {
        name: Some("driver".to_owned()),
        node: built.nodes,
        initializer: built.constants,
        input: vec![value_info(WINDOW, vec![many(), steps, size(INPUTS)])],
        output: vec![value_info(RAW_ACCEL, vec![many(), size(1)])],
    }
}

/// From torch's order of the gates, in which our weights lie (input, forget, cell, output), to ONNX's (input, output, forget,
/// cell): the rows of each gate move together. A row has `values / (4 · hidden)` values.
pub(super) fn in_onnx_order(values: &[f32], hidden: usize) -> Vec<f32> {
    let gate = values.len() / 4;
    debug_assert_eq!(gate % hidden, 0, "whole rows");
    [0, 3, 1, 2].into_iter().flat_map(|of| &values[of * gate..(of + 1) * gate]).copied().collect()
}

/// Mean and spread of every input that is read.
fn standardisation(scaling: &Scaling, features: Features) -> (Vec<f32>, Vec<f32>) {
    let motion = scaling.motion.unwrap_or(MotionScaling { mean: [0.0; 3], spread: [1.0; 3] });
    match features {
        Features::Raw => (scaling.mean.to_vec(), scaling.spread.to_vec()),
        Features::Motion => {
            ([&scaling.mean[..], &motion.mean].concat(), [&scaling.spread[..], &motion.spread].concat())
        }
    }
}

impl Builder {
    /// The window with the inputs of [`Features::Motion`] behind its own: accelerations since its first step, and the inverse
    /// time to collision.
    fn with_motion(&mut self, shape: DriverShape) -> String {
        let speeds = self.slice(WINDOW, "speeds", 0..2, 2);
        let first = self.slice(&speeds, "first_speeds", 0..1, 1);
        let gained = self.node("Sub", &[&speeds, &first], "gained", vec![]);
        // At the first step nothing is gained, whatever it is divided by.
        let elapsed: Vec<f32> = (0..shape.horizon).map(|t| if t == 0 { 1.0 } else { t as f32 * shape.dt_s }).collect();
        let elapsed = self.floats("elapsed_s", &[1, shape.horizon, 1], &elapsed);
        let accelerations = self.node("Div", &[&gained, &elapsed], "accelerations", vec![]);
        let relative = self.slice(WINDOW, "relative_speed", 2..3, 2);
        let spacing = self.slice(WINDOW, "spacing", 3..4, 2);
        let positive = self.node("Relu", &[&spacing], "positive_spacing", vec![]);
        let least = self.floats("least_spacing_m", &[], &[1.0]);
        let room = self.node("Add", &[&positive, &least], "room", vec![]);
        let inverse_ttc = self.node("Div", &[&relative, &room], "inverse_ttc", vec![]);
        self.node("Concat", &[WINDOW, &accelerations, &inverse_ttc], "inputs", vec![int("axis", 2)])
    }

    fn slice(&mut self, of: &str, name: &str, range: std::ops::Range<usize>, axis: usize) -> String {
        let starts = self.integers(&format!("{name}_from"), &[signed(range.start)]);
        let ends = self.integers(&format!("{name}_to"), &[signed(range.end)]);
        let axes = self.integers(&format!("{name}_axis"), &[signed(axis)]);
        self.node("Slice", &[of, &starts, &ends, &axes], name, vec![])
    }

    /// An LSTM over all steps from a zero state, of which only the last state is asked for.
    fn lstm(&mut self, inputs: &[&str], hidden: usize) -> String {
        let output = self.node("LSTM", inputs, "last", vec![int("hidden_size", signed(hidden))]);
        // Its outputs are all states, the last, and the last cell.
        self.nodes.last_mut().expect("just added").output = vec![String::new(), output.clone()];
        output
    }

    fn node(&mut self, operator: &str, inputs: &[&str], output: &str, attribute: Vec<Attribute>) -> String {
        self.nodes.push(Node {
            input: inputs.iter().map(|&input| input.to_owned()).collect(),
            output: vec![output.to_owned()],
            name: Some(format!("{operator}_{output}")),
            op_type: Some(operator.to_owned()),
            attribute,
        });
        output.to_owned()
    }

    fn floats(&mut self, name: &str, dims: &[usize], values: &[f32]) -> String {
        self.constant(name, dims, FLOAT, values.iter().flat_map(|x| x.to_le_bytes()).collect())
    }

    fn integers(&mut self, name: &str, values: &[i64]) -> String {
        self.constant(name, &[values.len()], INT64, values.iter().flat_map(|x| x.to_le_bytes()).collect())
    }

    fn constant(&mut self, name: &str, dims: &[usize], data_type: i32, raw_data: Vec<u8>) -> String {
        self.constants.push(Tensor {
            dims: dims.iter().map(|&size| signed(size)).collect(),
            data_type: Some(data_type),
            name: Some(name.to_owned()),
            raw_data: Some(raw_data),
        });
        name.to_owned()
    }
}

fn signed(size: usize) -> i64 {
    i64::try_from(size).expect("sizes of a network are small")
}

fn int(name: &str, value: i64) -> Attribute {
    Attribute { name: Some(name.to_owned()), i: Some(value), ints: vec![], kind: Some(ATTRIBUTE_INT) }
}

fn ints(name: &str, values: &[i64]) -> Attribute {
    Attribute { name: Some(name.to_owned()), i: None, ints: values.to_vec(), kind: Some(ATTRIBUTE_INTS) }
}

/// As many windows as are asked for.
fn many() -> Dimension {
    Dimension { size: None, name: Some("n".to_owned()) }
}

fn size(size: usize) -> Dimension {
    Dimension { size: Some(signed(size)), name: None }
}

fn value_info(name: &str, dim: Vec<Dimension>) -> ValueInfo {
    let tensor = TensorType { elem_type: Some(FLOAT), shape: Some(Shape { dim }) };
    ValueInfo { name: Some(name.to_owned()), kind: Some(Type { tensor: Some(tensor) }), doc_string: None }
}
