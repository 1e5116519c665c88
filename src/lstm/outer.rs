//! Sums of outer products: the gradient of the recurrent weights.

use super::Real;
use super::lanes::{Kernel, Lanes};
use super::lines::{LINE, Line};

/// Rows of one step: where their derivatives and the states before them begin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    pub(super) rows: usize,
    /// Among the derivatives by pre-activations, in lines of `rows`.
    pub(super) dz: usize,
    /// Among the states, in lines of `h_rows`, of which the first `rows` are read.
    pub(super) h: usize,
    pub(super) h_rows: usize,
}

/// Pre-activations that are summed together: a part of a line.
pub(super) const OUTPUTS: usize = 8;
/// Lines of units that are summed together.
pub(super) const TOGETHER: usize = 2;

/// Where the sum of a line of units lies: those of all pre-activations beside each other, so that they are read in one stretch.
#[inline(always)]
pub(super) fn place(outputs: usize, output: usize, line: usize) -> usize {
    (line / TOGETHER * outputs + output) * TOGETHER + line % TOGETHER
}

/// Adds `Σ dz h'ᵀ` over the rows of some steps: a sum is loaded and stored once for all of them, and is the same however steps
/// are put together, since it runs over rows in their order.
#[derive(Debug)]
pub(super) struct OuterProducts<'a, T> {
    pub(super) segments: &'a [Segment],
    pub(super) dz: &'a [Line<T>],
    pub(super) h: &'a [Line<T>],
    /// Lines of units.
    pub(super) lines: usize,
    /// Pre-activations.
    pub(super) outputs: usize,
    /// In the order of [`place`].
    pub(super) sums: &'a mut [Line<T>],
}

impl<T: Real> Kernel<T> for OuterProducts<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(mut self, l: L) {
        let mut at = 0;
        // States of two lines stay in the first-level cache while all derivatives pass over them.
        while at < self.lines {
            for output in 0..self.outputs / LINE {
                for from in (0..LINE).step_by(OUTPUTS) {
                    if L::WIDTH == LINE && at + TOGETHER <= self.lines {
                        self.tile::<L, TOGETHER>(l, (output, from), (at, 0));
                        continue;
                    }
                    for line in at..self.lines.min(at + TOGETHER) {
                        for lane in (0..LINE).step_by(L::WIDTH) {
                            self.tile::<L, 1>(l, (output, from), (line, lane));
                        }
                    }
                }
            }
            at += TOGETHER;
        }
    }
}

impl<T: Real> OuterProducts<'_, T> {
    /// Some pre-activations from `from` on of a line of them, by `G` lines of units from line `at` on, in registers: one vector of
    /// each, from `lane` on.
    #[inline(always)]
    fn tile<L: Lanes<Number = T>, const G: usize>(
        &mut self,
        l: L,
        (output, from): (usize, usize),
        (at, lane): (usize, usize),
    ) {
        let place = place(self.outputs, output * LINE + from, at);
        let mut sums = [[l.splat(T::zero()); G]; OUTPUTS];
        for n in 0..OUTPUTS {
            for g in 0..G {
                sums[n][g] = l.load(&self.sums[place + n * TOGETHER + g].0[lane..]);
            }
        }
        for &Segment { rows, dz, h, h_rows } in self.segments {
            let dz = &self.dz[dz + output * rows..][..rows];
            let h: [&[Line<T>]; G] = std::array::from_fn(
                #[inline(always)]
                |g| &self.h[h + (at + g) * h_rows..][..rows],
            );
            for row in 0..rows {
                let dz: &[T; OUTPUTS] = dz[row].0[from..].first_chunk().expect("a line has as many");
                let h: [L::Value; G] = std::array::from_fn(
                    #[inline(always)]
                    |g| l.load(&h[g][row].0[lane..]),
                );
                for n in 0..OUTPUTS {
                    let dz = l.splat(dz[n]);
                    for g in 0..G {
                        sums[n][g] = l.fma(dz, h[g], sums[n][g]);
                    }
                }
            }
        }
        for n in 0..OUTPUTS {
            for g in 0..G {
                l.store(&mut self.sums[place + n * TOGETHER + g].0[lane..], sums[n][g]);
            }
        }
    }
}
