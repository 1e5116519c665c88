//! What the way back adds up, in lines, until it is handed over in the order of the flat vector.

use super::lines::{GATES, LINE, Line, gate_row, lines};
use super::tiles::{TOGETHER, place};
use super::{Layout, Real};

/// Sums of a gradient's parts.
#[derive(Debug)]
pub(super) struct Gradient<T> {
    layout: Layout,
    /// Input by input, the weights of all pre-activations, then the bias.
    pub(super) input: Vec<Line<T>>,
    /// Of each pre-activation, the lines of units.
    pub(super) recurrent: Vec<Line<T>>,
    pub(super) head: Vec<Line<T>>,
    pub(super) head_bias: T,
}

impl<T: Real> Gradient<T> {
    /// Zeros.
    pub(super) fn new(layout: Layout) -> Self {
        let lines = lines(layout.hidden);
        Self {
            layout,
            input: vec![Line::zero(); (layout.inputs + 1) * GATES * lines],
            recurrent: vec![Line::zero(); GATES * lines * LINE * lines.next_multiple_of(TOGETHER)],
            head: vec![Line::zero(); lines],
            head_bias: T::zero(),
        }
    }

    /// Zeros again.
    pub(super) fn clear(&mut self) {
        for sums in [&mut self.input, &mut self.recurrent, &mut self.head] {
            sums.fill(Line::zero());
        }
        self.head_bias = T::zero();
    }

    /// Adds them to a flat vector.
    pub(super) fn add_to(&self, gradient: &mut [T]) {
        let (layout, units) = (self.layout, lines(self.layout.hidden));
        let outputs = GATES * units;
        for output in 0..outputs * LINE {
            let Some(row) = gate_row(layout.hidden, output) else { continue };
            let input = |k: usize| self.input[k * outputs + output / LINE].0[output % LINE];
            for (k, g) in gradient[layout.input()][row * layout.inputs..][..layout.inputs].iter_mut().enumerate() {
                *g += input(k);
            }
            let recurrent = &mut gradient[layout.recurrent()][row * layout.hidden..][..layout.hidden];
            for (line, to) in recurrent.chunks_mut(LINE).enumerate() {
                add(&self.recurrent[place(outputs * LINE, output, line)], to);
            }
            gradient[layout.bias()][row] += input(layout.inputs);
        }
        for (sums, to) in self.head.iter().zip(gradient[layout.head()].chunks_mut(LINE)) {
            add(sums, to);
        }
        gradient[layout.head_bias()] += self.head_bias;
    }
}

fn add<T: Real>(sums: &Line<T>, to: &mut [T]) {
    for (to, sum) in to.iter_mut().zip(sums.0) {
        *to += sum;
    }
}
