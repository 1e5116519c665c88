//! A fixed matrix arranged once for many products with a few rows of work at a time.

use std::ops::Range;

use super::Real;
use super::lanes::{Kernel, Lanes};

/// Outputs of a block, a whole number of vectors of every instruction set.
const LANES: usize = 64;
/// Inputs of a slice: a block's slice of 64 × 128 f32 stays in the first-level cache while rows pass over it.
const SLICE: usize = 128;

/// Inputs taken in one stretch: what is checked once for all of them need not be checked for each.
const UNROLLED: usize = 8;

/// `inputs × outputs` values, cut into slices of inputs and blocks of outputs; a block's values lie in the order in which they
/// are read, outputs padded with zeros to whole blocks.
#[derive(Debug, Clone)]
pub(super) struct Packed<T> {
    inputs: usize,
    outputs: usize,
    values: Vec<T>,
}

impl<T: Real> Packed<T> {
    /// Nothing yet.
    pub(super) fn new() -> Self {
        Self { inputs: 0, outputs: 0, values: Vec::new() }
    }

    /// Takes the matrix whose entry for `input` and `output` is `value(input, output)`.
    pub(super) fn set(&mut self, inputs: usize, outputs: usize, value: impl Fn(usize, usize) -> T) {
        (self.inputs, self.outputs) = (inputs, outputs);
        self.values.clear();
        for slice in slices(inputs) {
            for from in (0..outputs).step_by(LANES) {
                for input in slice.clone() {
                    let block = (from..from + LANES).map(|o| if o < outputs { value(input, o) } else { T::zero() });
                    self.values.extend(block);
                }
            }
        }
    }

    /// `out = x · matrix`, row by row: rows × inputs times inputs × outputs. Each sum runs over the inputs in their order, with
    /// one rounding for each, whatever the rows beside it and the instructions of this machine.
    ///
    /// # Panics
    /// When the lengths do not fit.
    pub(super) fn multiply(&self, x: &[T], out: &mut [T]) {
        self.parts(x, out, |part| T::run(part));
    }

    fn parts(&self, x: &[T], out: &mut [T], run: impl Fn(Part<'_, '_, T>)) {
        assert_eq!(x.len() * self.outputs, out.len() * self.inputs, "as many rows come out as go in");
        let (inputs, outputs, blocks) = (self.inputs, self.outputs, self.outputs.div_ceil(LANES));
        for slice in slices(inputs) {
            let at = slice.start * blocks * LANES;
            for (block, values) in self.values[at..].chunks_exact(slice.len() * LANES).take(blocks).enumerate() {
                run(Part { values, slice: slice.clone(), inputs, from: block * LANES, outputs, x, out });
            }
        }
    }
}

fn slices(inputs: usize) -> impl Iterator<Item = Range<usize>> {
    (0..inputs).step_by(SLICE).map(move |from| from..inputs.min(from + SLICE))
}

/// One slice of one block, and the rows that pass over it.
#[derive(Debug)]
struct Part<'a, 'o, T> {
    values: &'a [T],
    slice: Range<usize>,
    inputs: usize,
    /// The block's first output.
    from: usize,
    outputs: usize,
    x: &'a [T],
    out: &'o mut [T],
}

impl<T: Real> Kernel<T> for Part<'_, '_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(mut self, lanes: L) {
        match (L::SUMS, self.slice.start) {
            (16, 0) => self.rows::<L, 8, true>(lanes),
            (16, _) => self.rows::<L, 8, false>(lanes),
            (_, 0) => self.rows::<L, 4, true>(lanes),
            _ => self.rows::<L, 4, false>(lanes),
        }
    }
}

impl<T: Real> Part<'_, '_, T> {
    /// All rows, `N` at a time by two vectors, what is left of them by more. The first slice begins the sums.
    #[inline(always)]
    fn rows<L: Lanes<Number = T>, const N: usize, const FIRST: bool>(&mut self, l: L) {
        let rows = self.x.len() / self.inputs;
        let mut row = 0;
        while row + N <= rows {
            self.lanes::<L, N, 2, FIRST>(l, row);
            row += N;
        }
        if row + 4 <= rows {
            self.lanes::<L, 4, 2, FIRST>(l, row);
            row += 4;
        }
        while row < rows {
            self.lanes::<L, 1, 4, FIRST>(l, row);
            row += 1;
        }
    }

    /// `N` rows, until the block is through; their sums are in registers.
    #[inline(always)]
    fn lanes<L: Lanes<Number = T>, const N: usize, const V: usize, const FIRST: bool>(&mut self, l: L, row: usize) {
        let Self { values, ref slice, inputs, from, outputs, x, ref mut out } = *self;
        let x: [&[T]; N] = std::array::from_fn(
            #[inline(always)]
            |n| &x[(row + n) * inputs + slice.start..][..slice.len()],
        );
        let count = (outputs - from).min(LANES);
        for lane in (0..LANES).step_by(V * L::WIDTH) {
            let mut sums = [[l.splat(T::zero()); V]; N];
            if !FIRST {
                for n in 0..N {
                    for v in 0..V {
                        sums[n][v] = load(l, &out[(row + n) * outputs + from..][..count], lane + v * L::WIDTH);
                    }
                }
            }
            let (turns, rest) = values.as_chunks::<{ UNROLLED * LANES }>();
            for (turn, values) in turns.iter().enumerate() {
                let x: [&[T; UNROLLED]; N] = std::array::from_fn(
                    #[inline(always)]
                    |n| x[n][turn * UNROLLED..].first_chunk().expect("a row has as many inputs as the slice"),
                );
                for k in 0..UNROLLED {
                    let w = vectors::<L, V>(l, &values[k * LANES + lane..]);
                    for n in 0..N {
                        let x = l.splat(x[n][k]);
                        for v in 0..V {
                            sums[n][v] = l.fma(x, w[v], sums[n][v]);
                        }
                    }
                }
            }
            for (k, values) in rest.chunks_exact(LANES).enumerate() {
                let w = vectors::<L, V>(l, &values[lane..]);
                for n in 0..N {
                    let x = l.splat(x[n][turns.len() * UNROLLED + k]);
                    for v in 0..V {
                        sums[n][v] = l.fma(x, w[v], sums[n][v]);
                    }
                }
            }
            for n in 0..N {
                for v in 0..V {
                    store(l, &mut out[(row + n) * outputs + from..][..count], lane + v * L::WIDTH, sums[n][v]);
                }
            }
        }
    }
}

#[inline(always)]
fn vectors<L: Lanes, const V: usize>(l: L, from: &[L::Number]) -> [L::Value; V] {
    let from = &from[..V * L::WIDTH];
    std::array::from_fn(
        #[inline(always)]
        |v| l.load(&from[v * L::WIDTH..]),
    )
}

/// The values from `at` on; of those beyond the end of `from`, which belong to nobody, anything.
#[inline(always)]
fn load<L: Lanes>(l: L, from: &[L::Number], at: usize) -> L::Value {
    if at + L::WIDTH <= from.len() {
        return l.load(&from[at..]);
    }
    let mut part = [L::Number::of(0.0); LANES];
    let left = from.len().saturating_sub(at);
    part[..left].copy_from_slice(&from[from.len() - left..]);
    l.load(&part)
}

#[inline(always)]
fn store<L: Lanes>(l: L, to: &mut [L::Number], at: usize, value: L::Value) {
    if at + L::WIDTH <= to.len() {
        return l.store(&mut to[at..], value);
    }
    let mut part = [L::Number::of(0.0); LANES];
    l.store(&mut part, value);
    let left = to.len().saturating_sub(at);
    let from = to.len() - left;
    to[from..].copy_from_slice(&part[..left]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lstm::lanes::Single;

    #[test]
    fn products_are_sums_in_order_whatever_the_rows_and_the_instructions() {
        for (inputs, outputs) in [(1, 1), (3, 5), (128, 512), (130, 64), (512, 128), (300, 70)] {
            let value = |i: usize, o: usize| ((i * 7 + o * 3) % 11) as f32 / 11.0 - 0.4;
            let mut packed = Packed::new();
            packed.set(inputs, outputs, value);
            for rows in [1, 2, 5, 8, 15] {
                let x: Vec<f32> = (0..rows * inputs).map(|i| ((i * 5) % 13) as f32 / 13.0 - 0.5).collect();
                let sum = |row: usize, o: usize| {
                    (0..inputs).fold(0.0, |sum: f32, i| x[row * inputs + i].mul_add(value(i, o), sum))
                };
                let expected: Vec<f32> = (0..rows * outputs).map(|at| sum(at / outputs, at % outputs)).collect();
                let mut out = vec![f32::NAN; rows * outputs];
                packed.multiply(&x, &mut out);
                assert_eq!(out, expected, "{rows}×{inputs}×{outputs}");
                out.fill(f32::NAN);
                packed.parts(&x, &mut out, |part| part.run(Single::new()));
                assert_eq!(out, expected, "{rows}×{inputs}×{outputs}, one by one");
            }
        }
    }
}
