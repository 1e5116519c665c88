//! A fixed matrix arranged for products with a few rows of work at a time, sixty-four outputs of them in registers.

use super::Real;
use super::lanes::Lanes;
use super::lines::{GATES, LINE, Line, Lines};

/// Outputs that are computed together, in lines: the four gates of a line of units.
pub(super) const BLOCK: usize = GATES;
/// Rows that share each load of a weight: with [`BLOCK`] lines their sums fill the registers of AVX-512.
pub(super) const ROWS: usize = 6;

/// The weights of one input for the outputs of a block.
pub(super) type Term<T> = [Line<T>; BLOCK];

/// `inputs × outputs` weights, block by block of outputs, of each block a [`Term`] for each input. Where there is no output or
/// no input they are 0.
#[derive(Debug)]
pub(super) struct Arranged<T> {
    inputs: usize,
    terms: Vec<Term<T>>,
}

impl<T: Real> Arranged<T> {
    /// Nothing yet.
    pub(super) fn new() -> Self {
        Self { inputs: 0, terms: Vec::new() }
    }

    /// Takes the weights of so many lines of inputs and outputs.
    pub(super) fn set(&mut self, inputs: usize, outputs: usize, weight: impl Fn(usize, usize) -> T) {
        self.inputs = inputs * LINE;
        self.terms.clear();
        for block in 0..outputs.div_ceil(BLOCK) {
            self.terms.extend((0..self.inputs).map(|input| {
                std::array::from_fn(|line| {
                    let line = block * BLOCK + line;
                    Line(std::array::from_fn(|lane| {
                        if line < outputs { weight(input, line * LINE + lane) } else { T::zero() }
                    }))
                })
            }));
        }
    }

    /// The terms of each block of outputs.
    #[inline(always)]
    pub(super) fn blocks(&self) -> impl ExactSizeIterator<Item = &[Term<T>]> {
        self.terms.chunks_exact(self.inputs)
    }
}

/// Runs `$part` for as many rows at once as make full use of the registers, then for what is left of `$rows`.
macro_rules! in_groups {
    ($rows:expr, $row:ident => $part:ident::<$l:ident>($($argument:expr),*)) => {{
        let mut $row = 0;
        if $l::WIDTH == LINE {
            while $row + ROWS <= $rows {
                $part::<$l, ROWS>($($argument),*);
                $row += ROWS;
            }
            match $rows - $row {
                5 => $part::<$l, 5>($($argument),*),
                4 => $part::<$l, 4>($($argument),*),
                3 => $part::<$l, 3>($($argument),*),
                2 => $part::<$l, 2>($($argument),*),
                1 => $part::<$l, 1>($($argument),*),
                _ => {}
            }
        } else {
            while $row + 4 <= $rows {
                $part::<$l, 4>($($argument),*);
                $row += 4;
            }
            while $row < $rows {
                $part::<$l, 1>($($argument),*);
                $row += 1;
            }
        }
    }};
}
pub(super) use in_groups;

/// `sums += x · terms` for `N` rows from `row` on: the first `lines` lines of the block. `x` begins with the line that the
/// first term belongs to. Each sum runs over the inputs in their order, with one rounding for each.
#[inline(always)]
pub(super) fn add_products<L: Lanes, const N: usize>(
    l: L,
    terms: &[Term<L::Number>],
    x: (Lines<'_, L::Number>, usize),
    row: usize,
    lines: usize,
    sums: &mut [Term<L::Number>; N],
) {
    if L::WIDTH == LINE && lines == BLOCK {
        return in_registers::<L, N, BLOCK, 1>(l, terms, x, row, (0, 0), sums);
    }
    for line in 0..lines {
        if L::WIDTH > 1 && L::WIDTH < LINE {
            for lane in (0..LINE).step_by(2 * L::WIDTH) {
                in_registers::<L, N, 1, 2>(l, terms, x, row, (line, lane), sums);
            }
        } else {
            for lane in (0..LINE).step_by(L::WIDTH) {
                in_registers::<L, N, 1, 1>(l, terms, x, row, (line, lane), sums);
            }
        }
    }
}

/// `G` lines of `V` vectors each, from a line of the block and a lane on.
#[inline(always)]
fn in_registers<L: Lanes, const N: usize, const G: usize, const V: usize>(
    l: L,
    terms: &[Term<L::Number>],
    (x, first): (Lines<'_, L::Number>, usize),
    row: usize,
    (from, lane): (usize, usize),
    sums: &mut [Term<L::Number>; N],
) {
    let mut kept = [[[l.splat(L::Number::of(0.0)); V]; G]; N];
    for n in 0..N {
        for g in 0..G {
            for v in 0..V {
                kept[n][g][v] = l.load(&sums[n][from + g].0[lane + v * L::WIDTH..]);
            }
        }
    }
    let (whole, rest) = terms.as_chunks::<LINE>();
    for (line, terms) in whole.iter().enumerate() {
        let x: &[Line<L::Number>; N] =
            x.line(first + line)[row..].first_chunk().expect("as many rows as are asked for");
        for k in 0..LINE {
            let w: [[L::Value; V]; G] = std::array::from_fn(
                #[inline(always)]
                |g| {
                    std::array::from_fn(
                        #[inline(always)]
                        |v| l.load(&terms[k][from + g].0[lane + v * L::WIDTH..]),
                    )
                },
            );
            for n in 0..N {
                let x = l.splat(x[n].0[k]);
                for g in 0..G {
                    for v in 0..V {
                        kept[n][g][v] = l.fma(x, w[g][v], kept[n][g][v]);
                    }
                }
            }
        }
    }
    debug_assert!(rest.is_empty(), "inputs are whole lines");
    for n in 0..N {
        for g in 0..G {
            for v in 0..V {
                l.store(&mut sums[n][from + g].0[lane + v * L::WIDTH..], kept[n][g][v]);
            }
        }
    }
}
