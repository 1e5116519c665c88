//! Sums of outer products: the gradient of the recurrent weights.

use super::Real;
use super::lanes::{Kernel, Lanes};
use super::lines::{LINE, Line};
use super::tiles::{OUTPUTS, TOGETHER, Tiles, add_outer, each_tile, place};

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
        each_tile(l, self.outputs, self.lines, &mut self);
    }
}

impl<T: Real> Tiles<T> for OuterProducts<'_, T> {
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
                add_outer(l, dz, h, &mut sums);
            }
        }
        for n in 0..OUTPUTS {
            for g in 0..G {
                l.store(&mut self.sums[place + n * TOGETHER + g].0[lane..], sums[n][g]);
            }
        }
    }
}
