//! Weights, and the same weights arranged for the passes: once an update, not once a product.

use super::arranged::Arranged;
use super::encode::dot;
use super::lanes::{Lanes, Units, each_unit};
use super::lines::{GATES, LINE, Line, gate_row, in_lines, lines};
use super::packed::Packed;
use super::{Layout, Real};

/// A network's weights, ready to go forward and backward through events.
#[derive(Debug)]
pub struct Network<T> {
    layout: Layout,
    weights: Vec<T>,
    /// The input weights transposed, inputs × gates.
    input: Vec<T>,
    /// The recurrent weights from a state to the gates.
    pub(super) forward: Packed<T>,
    /// The same from the gates' derivatives to the state's.
    pub(super) backward: Packed<T>,
    /// Input by input, the input weights of all pre-activations, in lines.
    pub(super) input_lines: Vec<Line<T>>,
    pub(super) bias: Vec<Line<T>>,
    pub(super) head: Vec<Line<T>>,
    /// The recurrent weights from units to gates, and from gates to units.
    pub(super) to_gates: Arranged<T>,
    pub(super) to_states: Arranged<T>,
}

impl<T: Real> Network<T> {
    /// A network of these weights.
    ///
    /// # Panics
    /// When their number does not fit the layout.
    #[must_use]
    pub fn new(layout: Layout, weights: &[T]) -> Self {
        let mut network = Self {
            layout,
            weights: Vec::new(),
            input: Vec::new(),
            forward: Packed::new(),
            backward: Packed::new(),
            input_lines: Vec::new(),
            bias: Vec::new(),
            head: Vec::new(),
            to_gates: Arranged::new(),
            to_states: Arranged::new(),
        };
        network.set(weights);
        network
    }

    /// Takes other weights.
    ///
    /// # Panics
    /// When their number does not fit the layout.
    pub fn set(&mut self, weights: &[T]) {
        assert_eq!(weights.len(), self.layout.len(), "the weights fit the layout");
        self.weights.clear();
        self.weights.extend_from_slice(weights);
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let inputs = self.layout.inputs;
        let input = &self.weights[self.layout.input()];
        self.input.clear();
        self.input.extend((0..inputs * gates).map(|at| input[(at % gates) * inputs + at / gates]));
        let recurrent = &self.weights[self.layout.recurrent()];
        self.forward.set(hidden, gates, |unit, gate| recurrent[gate * hidden + unit]);
        self.backward.set(gates, hidden, |gate, unit| recurrent[gate * hidden + unit]);
        let units = lines(hidden);
        let row = |at: usize| gate_row(hidden, at);
        let gate_lines = |value: &dyn Fn(usize) -> T| -> Vec<Line<T>> {
            (0..GATES * units)
                .map(|line| Line(std::array::from_fn(|lane| row(line * LINE + lane).map_or(T::zero(), value))))
                .collect()
        };
        self.input_lines = (0..inputs).flat_map(|k| gate_lines(&|row| self.weights[row * inputs + k])).collect();
        let bias = &self.weights[self.layout.bias()];
        self.bias = gate_lines(&|row| bias[row]);
        self.head = in_lines(&self.weights[self.layout.head()]).collect();
        let weight = |at: usize, unit: usize| match row(at) {
            Some(row) if unit < hidden => recurrent[row * hidden + unit],
            _ => T::zero(),
        };
        self.to_gates.set(units, GATES * units, |unit, at| weight(at, unit));
        self.to_states.set(GATES * units, units, weight);
    }

    /// The head's bias.
    pub(super) fn head_bias(&self) -> T {
        self.weights[self.layout.head_bias()]
    }

    /// Its layout.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The flat vector.
    #[must_use]
    pub fn weights(&self) -> &[T] {
        &self.weights
    }

    /// `projected = W_ih x + b`, one row for each row of inputs.
    pub(super) fn project(&self, inputs: &[T], projected: &mut [T]) {
        each_unit(Project { network: self, inputs, projected });
    }

    /// The head's value for each of some states.
    pub(super) fn heads(&self, states: &[T], values: &mut Vec<T>) {
        let (head, bias) = (&self.weights[self.layout.head()], self.weights[self.layout.head_bias()]);
        values.clear();
        values.extend(states.chunks_exact(self.layout.hidden).map(|h| dot(head, h) + bias));
    }
}

struct Project<'a, T> {
    network: &'a Network<T>,
    inputs: &'a [T],
    projected: &'a mut [T],
}

impl<T: Real> Units<T> for Project<'_, T> {
    #[inline(always)]
    fn size(&self) -> (usize, usize) {
        (self.inputs.len() / self.network.layout.inputs, self.network.layout.gates())
    }

    #[inline(always)]
    fn unit<L: Lanes<Number = T>>(&mut self, l: L, row: usize, gate: usize) {
        let Network { layout, weights, input, .. } = self.network;
        let mut sum = l.load(&weights[layout.bias()][gate..]);
        let inputs = &self.inputs[row * layout.inputs..][..layout.inputs];
        for (x, w) in inputs.iter().zip(input.chunks_exact(layout.gates())) {
            sum = l.fma(l.load(&w[gate..]), l.splat(*x), sum);
        }
        l.store(&mut self.projected[row * layout.gates() + gate..], sum);
    }
}
