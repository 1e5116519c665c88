//! Weights, and the same weights arranged for the passes: once an update, not once a product.

use super::arranged::Arranged;
use super::ends::Project;
use super::lines::{GATES, LINE, Line, gate_row, in_lines, lines};
use super::{Layout, Real};

/// A network's weights, ready to go forward and backward through events.
#[derive(Debug)]
pub struct Network<T> {
    layout: Layout,
    weights: Vec<T>,
    /// Input by input, the input weights of all pre-activations, in lines.
    pub(super) input: Vec<Line<T>>,
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
        let Layout { hidden, inputs } = self.layout;
        let recurrent = &self.weights[self.layout.recurrent()];
        let units = lines(hidden);
        let row = |at: usize| gate_row(hidden, at);
        let gate_lines = |value: &dyn Fn(usize) -> T| -> Vec<Line<T>> {
            (0..GATES * units)
                .map(|line| Line(std::array::from_fn(|lane| row(line * LINE + lane).map_or(T::zero(), value))))
                .collect()
        };
        self.input = (0..inputs).flat_map(|k| gate_lines(&|row| self.weights[row * inputs + k])).collect();
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

    /// `W_ih x + b` of each row of inputs, in lines of them.
    pub(super) fn project(&self, inputs: &[T], projected: &mut [Line<T>]) {
        T::run(Project { weights: &self.input, bias: &self.bias, inputs, projected });
    }
}
