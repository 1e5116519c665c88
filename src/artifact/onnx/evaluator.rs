//! A plain evaluator of the operators that our graphs use, by ONNX's own formulas, in f64.

use std::collections::HashMap;

use super::graph::{FLOAT, INT64};
use super::messages::{Graph, Node, Tensor};

/// Numbers and their shape, row-major.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Values {
    pub(super) shape: Vec<usize>,
    pub(super) data: Vec<f64>,
}

impl Values {
    fn constant(tensor: &Tensor) -> Self {
        let raw = tensor.raw_data.as_ref().unwrap();
        let data = match tensor.data_type.unwrap() {
            FLOAT => raw.as_chunks::<4>().0.iter().map(|x| f32::from_le_bytes(*x).into()).collect(),
            INT64 => raw.as_chunks::<8>().0.iter().map(|x| i64::from_le_bytes(*x) as f64).collect(),
            other => panic!("type {other}"),
        };
        let shape = tensor.dims.iter().map(|&size| usize::try_from(size).unwrap()).collect();
        Self { shape, data }
    }

    /// Makes an array of this shape of a function of the index.
    fn of(shape: Vec<usize>, value: impl Fn(&[usize]) -> f64) -> Self {
        let mut data = Vec::new();
        let mut index = vec![0; shape.len()];
        for _ in 0..shape.iter().product() {
            data.push(value(&index));
            for axis in (0..shape.len()).rev() {
                index[axis] += 1;
                if index[axis] < shape[axis] {
                    break;
                }
                index[axis] = 0;
            }
        }
        Self { shape, data }
    }

    /// At an index of an array that this one is broadcast to.
    fn at(&self, index: &[usize]) -> f64 {
        let own = &index[index.len() - self.shape.len()..];
        let place = own.iter().zip(&self.shape).fold(0, |at, (&i, &size)| at * size + if size == 1 { 0 } else { i });
        self.data[place]
    }

    fn with(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let (long, short) = if self.shape.len() >= other.shape.len() { (self, other) } else { (other, self) };
        let missing = long.shape.len() - short.shape.len();
        let sizes = long.shape.iter().enumerate();
        let shape = sizes.map(|(k, &size)| if k < missing { size } else { size.max(short.shape[k - missing]) });
        Self::of(shape.collect(), |index| f(self.at(index), other.at(index)))
    }

    fn each(&self, f: impl Fn(f64) -> f64) -> Self {
        Self { shape: self.shape.clone(), data: self.data.iter().map(|&x| f(x)).collect() }
    }
}

/// What the graph's only output is for its only input.
pub(super) fn evaluate(graph: &Graph, input: Values) -> Values {
    let constants = graph.initializer.iter().map(|tensor| (tensor.name.clone().unwrap(), Values::constant(tensor)));
    let mut known: HashMap<String, Values> = constants.collect();
    known.insert(graph.input[0].name.clone().unwrap(), input);
    for node in &graph.node {
        let inputs: Vec<&Values> = node.input.iter().map(|name| &known[name]).collect();
        let value = run(node, &inputs);
        known.insert(node.output.last().unwrap().clone(), value);
    }
    known.remove(graph.output[0].name.as_ref().unwrap()).unwrap()
}

fn run(node: &Node, inputs: &[&Values]) -> Values {
    let first = inputs[0];
    match node.op_type.as_deref().unwrap() {
        "Sub" => first.with(inputs[1], |a, b| a - b),
        "Add" => first.with(inputs[1], |a, b| a + b),
        "Mul" => first.with(inputs[1], |a, b| a * b),
        "Div" => first.with(inputs[1], |a, b| a / b),
        "Relu" => first.each(|x| x.max(0.0)),
        "Tanh" => first.each(f64::tanh),
        "Slice" => {
            let [from, to, axis] = [1, 2, 3].map(|k| inputs[k].data[0] as usize);
            let mut shape = first.shape.clone();
            shape[axis] = to - from;
            Values::of(shape, |index| {
                let mut index = index.to_vec();
                index[axis] += from;
                first.at(&index)
            })
        }
        "Concat" => concat(inputs, usize::try_from(node.attribute[0].i.unwrap()).unwrap()),
        "Transpose" => {
            let perm: Vec<_> = node.attribute[0].ints.iter().map(|&axis| usize::try_from(axis).unwrap()).collect();
            let shape = perm.iter().map(|&axis| first.shape[axis]).collect();
            Values::of(shape, |index| {
                let mut from = vec![0; index.len()];
                for (&axis, &i) in perm.iter().zip(index) {
                    from[axis] = i;
                }
                first.at(&from)
            })
        }
        "Squeeze" => {
            let axis = inputs[1].data[0] as usize;
            let mut shape = first.shape.clone();
            assert_eq!(shape.remove(axis), 1);
            Values { shape, data: first.data.clone() }
        }
        "Gemm" => {
            assert_eq!((node.attribute[0].name.as_deref(), node.attribute[0].i), (Some("transB"), Some(1)));
            let shape = vec![first.shape[0], inputs[1].shape[0]];
            let term = |at: &[usize], k| first.at(&[at[0], k]) * inputs[1].at(&[at[1], k]);
            let sum = |at: &[usize]| (0..first.shape[1]).map(|k| term(at, k)).sum::<f64>();
            Values::of(shape, |at| sum(at) + inputs[2].at(at))
        }
        "LSTM" => lstm(inputs, usize::try_from(node.attribute[0].i.unwrap()).unwrap()),
        other => panic!("{other}"),
    }
}

fn concat(inputs: &[&Values], axis: usize) -> Values {
    let mut shape = inputs[0].shape.clone();
    shape[axis] = inputs.iter().map(|values| values.shape[axis]).sum();
    Values::of(shape, |index| {
        let mut index = index.to_vec();
        for values in inputs {
            if index[axis] < values.shape[axis] {
                return values.at(&index);
            }
            index[axis] -= values.shape[axis];
        }
        unreachable!("an index of the whole")
    })
}

/// ONNX's LSTM, one direction, as its reference has it: `it = σ(Xt·Wiᵀ + Ht₋₁·Riᵀ + Wbi + Rbi)`, and so on, in the order of
/// gates i, o, f, c; gives `Y_h`, `[1, n, hidden]`.
fn lstm(inputs: &[&Values], hidden: usize) -> Values {
    let [x, w, r, b] = [inputs[0], inputs[1], inputs[2], inputs[3]];
    let (steps, n, width) = (x.shape[0], x.shape[1], x.shape[2]);
    let sigmoid = |z: f64| 1.0 / (1.0 + (-z).exp());
    let mut last = vec![0.0; n * hidden];
    for row in 0..n {
        let (mut h, mut c) = (vec![0.0; hidden], vec![0.0; hidden]);
        for t in 0..steps {
            let z = |gate: usize, unit: usize| {
                let line = gate * hidden + unit;
                let read: f64 = (0..width).map(|k| x.at(&[t, row, k]) * w.at(&[0, line, k])).sum();
                let carried: f64 = (0..hidden).map(|k| h[k] * r.at(&[0, line, k])).sum();
                read + carried + b.at(&[0, line]) + b.at(&[0, 4 * hidden + line])
            };
            let next: Vec<(f64, f64)> = (0..hidden)
                .map(|unit| {
                    let [i, o, f] = [0, 1, 2].map(|gate| sigmoid(z(gate, unit)));
                    let cell = f * c[unit] + i * z(3, unit).tanh();
                    (o * cell.tanh(), cell)
                })
                .collect();
            (h, c) = next.into_iter().unzip();
        }
        last[row * hidden..(row + 1) * hidden].copy_from_slice(&h);
    }
    Values { shape: vec![1, n, hidden], data: last }
}
