//! One step of the network for many rows: products and gates of a block of units at a time.

use pulp::{Arch, Simd, WithSimd};

use super::packed::{Block, Packed, Term};
use crate::lstm::gates::{begin, go_on};
use crate::lstm::lanes::{Lanes, Vectors};
use crate::lstm::lines::{GATES, LINE};

/// Rows that share each load of a weight.
const ROWS: usize = 6;

/// Rows of values, each beginning so many after the one before; 0 when all are the same.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub(super) values: &'a [f32],
    pub(super) stride: usize,
}

/// States of some rows, [`Packed::units`] values each.
#[derive(Debug, Clone, Copy)]
pub(super) struct States<'a> {
    pub(super) h: &'a [f32],
    pub(super) c: &'a [f32],
}

/// Where the states after a step go.
#[derive(Debug)]
pub(super) struct StatesMut<'a> {
    pub(super) h: &'a mut [f32],
    pub(super) c: &'a mut [f32],
}

/// One step of some rows. Every sum runs over its terms in one order whatever the rows and the instructions, so that the bits
/// of a row depend on nothing but itself.
#[derive(Debug)]
pub(super) struct Step<'a> {
    pub(super) packed: &'a Packed,
    pub(super) inputs: Rows<'a>,
    /// None: the rows begin, from a zero state.
    pub(super) before: Option<States<'a>>,
    pub(super) after: StatesMut<'a>,
    /// Takes the last block first. Steps that go to and fro find the block where they turn in the first cache.
    pub(super) backwards: bool,
}

impl Step<'_> {
    /// Takes the step with the best instructions of this machine.
    pub(super) fn take(self) {
        Arch::new().dispatch(self);
    }

    /// Computes a block of units for `N` rows from `row` on.
    #[inline(always)]
    fn group<S: Simd, const N: usize>(&mut self, simd: S, at: usize, row: usize) {
        let (units, Block { bias, input, recurrent }) = (self.packed.units(), self.packed.block(at));
        let mut projected = [[0.0; GATES * LINE]; N];
        sums(simd, Some(bias), input, self.inputs.from(row), &mut projected);
        let (l, place) = (Vectors::new(simd), |n: usize| (row + n) * units + at * LINE);
        let mut z = [[0.0; GATES * LINE]; N];
        if let Some(States { h, .. }) = self.before {
            sums(simd, None, recurrent, Rows { values: h, stride: units }.from(row), &mut z);
        }
        for n in 0..N {
            for lane in (0..LINE).step_by(Vectors::<S>::WIDTH) {
                let at = place(n) + lane;
                let p = gates(l, &projected[n], lane);
                let (_, c, h) = match self.before {
                    Some(States { c, .. }) => go_on(l, gates(l, &z[n], lane), p, l.load(&c[at..])),
                    None => begin(l, p),
                };
                l.store(&mut self.after.c[at..], c);
                l.store(&mut self.after.h[at..], h);
            }
        }
    }
}

/// The four gates of some units of a block.
#[inline(always)]
fn gates<L: Lanes<Number = f32>>(l: L, block: &[f32; GATES * LINE], lane: usize) -> [L::Value; GATES] {
    std::array::from_fn(
        #[inline(always)]
        |gate| l.load(&block[gate * LINE + lane..]),
    )
}

impl WithSimd for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (rows, blocks) = (self.after.h.len() / self.packed.units(), self.packed.blocks());
        for turn in 0..blocks {
            let at = if self.backwards { blocks - 1 - turn } else { turn };
            let mut row = 0;
            while rows - row >= ROWS {
                self.group::<S, ROWS>(simd, at, row);
                row += ROWS;
            }
            match rows - row {
                5 => self.group::<S, 5>(simd, at, row),
                4 => self.group::<S, 4>(simd, at, row),
                3 => self.group::<S, 3>(simd, at, row),
                2 => self.group::<S, 2>(simd, at, row),
                1 => self.group::<S, 1>(simd, at, row),
                _ => {}
            }
        }
    }
}

impl<'a> Rows<'a> {
    #[inline(always)]
    pub(super) fn from(self, row: usize) -> Self {
        Self { values: &self.values[row * self.stride..], ..self }
    }

    #[inline(always)]
    fn row(self, n: usize, len: usize) -> &'a [f32] {
        &self.values[n * self.stride..][..len]
    }
}

/// `start + Σ terms · x` for each of `N` rows, in as many registers as the instructions have.
#[inline(always)]
fn sums<S: Simd, const N: usize>(
    simd: S,
    start: Option<&Term>,
    terms: &[Term],
    x: Rows<'_>,
    out: &mut [[f32; GATES * LINE]; N],
) {
    match (S::F32_LANES, N) {
        (16, _) => in_registers::<S, N, 4, 1>(simd, start, terms, x, out),
        (8, 1) => in_registers::<S, N, 4, 2>(simd, start, terms, x, out),
        (8, 2) => in_registers::<S, N, 2, 2>(simd, start, terms, x, out),
        (8, _) => in_registers::<S, N, 1, 2>(simd, start, terms, x, out),
        (4, _) => in_registers::<S, N, 1, 4>(simd, start, terms, x, out),
        _ => in_registers::<S, N, 1, 16>(simd, start, terms, x, out),
    }
}

/// Sums `LINES` gates at a time, `VECTORS` registers each.
#[inline(always)]
fn in_registers<S: Simd, const N: usize, const LINES: usize, const VECTORS: usize>(
    simd: S,
    start: Option<&Term>,
    terms: &[Term],
    x: Rows<'_>,
    out: &mut [[f32; GATES * LINE]; N],
) {
    let x: [&[f32]; N] = std::array::from_fn(|n| x.row(n, terms.len()));
    for gate in (0..GATES).step_by(LINES) {
        let mut sums = [[[simd.splat_f32s(0.0); VECTORS]; LINES]; N];
        if let Some(start) = start {
            for n in 0..N {
                for line in 0..LINES {
                    sums[n][line].copy_from_slice(S::as_simd_f32s(&start[gate + line].0).0);
                }
            }
        }
        for (k, term) in terms.iter().enumerate() {
            for n in 0..N {
                let x = simd.splat_f32s(x[n][k]);
                for line in 0..LINES {
                    let weights = S::as_simd_f32s(&term[gate + line].0).0;
                    for vector in 0..VECTORS {
                        sums[n][line][vector] = simd.mul_add_f32s(x, weights[vector], sums[n][line][vector]);
                    }
                }
            }
        }
        for n in 0..N {
            for line in 0..LINES {
                let out = &mut out[n][(gate + line) * LINE..][..LINE];
                S::as_mut_simd_f32s(out).0.copy_from_slice(&sums[n][line]);
            }
        }
    }
}
