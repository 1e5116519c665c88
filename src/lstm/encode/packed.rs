//! Weights in the order in which serving reads them.

use crate::lstm::Layout;
use crate::lstm::lines::{GATES, LINE, Line, in_lines};

/// What one term of their sums is multiplied by, for the four gates of the units of a block.
pub(super) type Term = [Line<f32>; GATES];

/// The weights, block by block of [`LINE`] hidden units: bias, input weights, recurrent weights, each a [`Term`].
///
/// With 128 units a block is 34 KB, which stays in the first cache while it is applied to many rows, and is read in one stretch.
/// Units that are missing from the last block have weights of 0, so that their states are 0.
#[derive(Debug, Clone)]
pub(super) struct Packed {
    layout: Layout,
    terms: Vec<Term>,
    head: Vec<Line<f32>>,
    head_bias: f32,
}

/// The weights of some neighbouring units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block<'a> {
    pub(super) bias: &'a Term,
    /// A term for each input.
    pub(super) input: &'a [Term],
    /// A term for each hidden unit.
    pub(super) recurrent: &'a [Term],
}

impl Packed {
    /// `weights` laid out as `layout` says.
    pub(super) fn new(layout: Layout, weights: &[f32]) -> Self {
        let Layout { hidden, inputs } = layout;
        let (input, recurrent, bias) =
            (&weights[layout.input()], &weights[layout.recurrent()], &weights[layout.bias()]);
        let mut terms = Vec::with_capacity(hidden.div_ceil(LINE) * (1 + inputs + hidden));
        for first in (0..hidden).step_by(LINE) {
            let term = |weight: &dyn Fn(usize) -> f32| -> Term {
                std::array::from_fn(|gate| line(first, hidden, |unit| weight(gate * hidden + unit)))
            };
            terms.push(term(&|row| bias[row]));
            terms.extend((0..inputs).map(|k| term(&|row| input[row * inputs + k])));
            terms.extend((0..hidden).map(|k| term(&|row| recurrent[row * hidden + k])));
        }
        let head = in_lines(&weights[layout.head()]).collect();
        Self { layout, terms, head, head_bias: weights[layout.head_bias()] }
    }

    /// Values of a row of states: hidden units, and those that fill the last block.
    pub(super) fn units(&self) -> usize {
        self.blocks() * LINE
    }

    pub(super) fn blocks(&self) -> usize {
        self.head.len()
    }

    #[inline(always)]
    pub(super) fn block(&self, at: usize) -> Block<'_> {
        let Layout { hidden, inputs } = self.layout;
        let each = 1 + inputs + hidden;
        let terms = &self.terms[at * each..(at + 1) * each];
        let (input, recurrent) = terms[1..].split_at(inputs);
        Block { bias: &terms[0], input, recurrent }
    }

    /// The head's value for a row of states: each lane along the lines, then one lane after another.
    #[inline(always)]
    pub(super) fn head_value(&self, h: &[f32]) -> f32 {
        let mut sums = [0.0; LINE];
        for (line, h) in self.head.iter().zip(h.as_chunks::<LINE>().0) {
            for lane in 0..LINE {
                sums[lane] += line.0[lane] * h[lane];
            }
        }
        sums.into_iter().fold(0.0, |total, sum| total + sum) + self.head_bias
    }
}

/// The values of the units from `first` on; 0 where there are no more.
fn line(first: usize, hidden: usize, value: impl Fn(usize) -> f32) -> Line<f32> {
    Line(std::array::from_fn(|lane| if first + lane < hidden { value(first + lane) } else { 0.0 }))
}
