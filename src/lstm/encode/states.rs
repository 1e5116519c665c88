//! States before and after a step, in two buffers that change places.

use super::packed::Packed;
use super::step::{Rows, States, StatesMut, Step};

/// States of some rows. A step reads the one buffer and writes the other.
#[derive(Debug, Default, Clone)]
pub(super) struct Turning {
    h: [Vec<f32>; 2],
    c: [Vec<f32>; 2],
    /// The buffer that the last step wrote.
    now: usize,
}

impl Turning {
    /// Has room for so many rows from now on; nothing is allocated when it had.
    pub(super) fn reserve(&mut self, packed: &Packed, rows: usize) {
        for buffer in self.h.iter_mut().chain(&mut self.c) {
            let len = rows * packed.units();
            if buffer.len() < len {
                buffer.resize(len, 0.0);
            }
        }
    }

    /// The state that the last step left in this row.
    pub(super) fn row(&self, packed: &Packed, row: usize) -> &[f32] {
        &self.h[self.now][row * packed.units()..][..packed.units()]
    }

    /// Advances the first `rows` rows, of which row n becomes row n + `beginning`; as many rows as that begin before them.
    /// `inputs` are those of the rows that it leaves behind.
    pub(super) fn step(&mut self, packed: &Packed, inputs: Rows<'_>, rows: usize, beginning: usize) {
        let units = packed.units();
        let (before, after) = (self.now, 1 - self.now);
        let [h_before, h_after] = both(&mut self.h, before);
        let [c_before, c_after] = both(&mut self.c, before);
        let (h_first, h_later) = h_after[..(beginning + rows) * units].split_at_mut(beginning * units);
        let (c_first, c_later) = c_after[..(beginning + rows) * units].split_at_mut(beginning * units);
        let backwards = after == 1;
        let (h, c) = (&h_before[..rows * units], &c_before[..rows * units]);
        let later = StatesMut { h: h_later, c: c_later };
        Step { packed, inputs: inputs.from(beginning), before: Some(States { h, c }), after: later, backwards }.take();
        let first = StatesMut { h: h_first, c: c_first };
        Step { packed, inputs, before: None, after: first, backwards }.take();
        self.now = after;
    }
}

/// The buffer with the index `first`, and the other one.
fn both(buffers: &mut [Vec<f32>; 2], first: usize) -> [&mut [f32]; 2] {
    let [a, b] = buffers;
    if first == 0 { [a, b] } else { [b, a] }
}
