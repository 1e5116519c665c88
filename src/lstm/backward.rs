//! One step backward: through the gates, and through the recurrent weights to the states before.

use super::Real;
use super::arranged::{Arranged, BLOCK, ROWS, Term, add_products, in_groups};
use super::gates::back;
use super::lanes::{Kernel, Lanes};
use super::lines::{GATES, LINE, Line, Lines};

/// From the derivatives by the states after a step to those by its gates' pre-activations and by the cells before it.
#[derive(Debug)]
pub(super) struct ThroughGates<'a, T> {
    /// The event of each row.
    pub(super) events: &'a [usize],
    /// Rows that began.
    pub(super) begun: usize,
    /// Gates.
    pub(super) z: Lines<'a, T>,
    /// Cells after the step and before it.
    pub(super) c: Lines<'a, T>,
    pub(super) c_before: Lines<'a, T>,
    /// By the states after it.
    pub(super) dh: Lines<'a, T>,
    pub(super) dc: Lines<'a, T>,
    /// Takes the derivatives by the pre-activations, of each row that went on.
    pub(super) dz: &'a mut [Line<T>],
    /// Adds them up over the rows that read the same input.
    pub(super) dz_sum: &'a mut [Line<T>],
    /// Events of those sums.
    pub(super) summed: usize,
    /// Takes the derivatives by the cells before, of each row that went on: lines of so many rows.
    pub(super) dc_before: &'a mut [Line<T>],
    pub(super) rows_before: usize,
}

impl<T: Real> Kernel<T> for ThroughGates<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, l: L) {
        let Self { events, begun, z, c, c_before, dh, dc, dz, dz_sum, summed, dc_before, rows_before } = self;
        let later = events.len() - begun;
        for (at, sums) in dz_sum.chunks_exact_mut(GATES * summed).enumerate() {
            let z = std::array::from_fn(
                #[inline(always)]
                |gate| &z.line(at * GATES + gate)[..events.len()],
            );
            let [c, dh, dc] = [c, dh, dc].map(
                #[inline(always)]
                |lines| &lines.line(at)[..events.len()],
            );
            let after = After { z, c, dh, dc };
            let mut sums = Sums { sums, summed };
            for row in 0..begun {
                for lane in (0..LINE).step_by(L::WIDTH) {
                    let (gates, c, by) = after.load(l, row, lane);
                    let (by, _) = back(l, gates, (c, l.splat(T::zero())), by);
                    sums.add(l, events[row], lane, by);
                }
            }
            if later == 0 {
                continue;
            }
            let c_before = &c_before.line(at)[..later];
            let dc_before = &mut dc_before[at * rows_before..][..later];
            let dz = &mut dz[at * GATES * later..][..GATES * later];
            for row in 0..later {
                for lane in (0..LINE).step_by(L::WIDTH) {
                    let (gates, c, by) = after.load(l, begun + row, lane);
                    let (by, dc) = back(l, gates, (c, l.load(&c_before[row].0[lane..])), by);
                    l.store(&mut dc_before[row].0[lane..], l.mul(dc, gates[1]));
                    for gate in 0..GATES {
                        l.store(&mut dz[gate * later + row].0[lane..], by[gate]);
                    }
                    sums.add(l, events[begun + row], lane, by);
                }
            }
        }
    }
}

/// Gates, cell, and the derivatives by hidden state and cell, of some units.
type Loaded<V> = ([V; GATES], V, (V, V));

/// A line of units of all rows, after the step.
struct After<'a, T> {
    z: [&'a [Line<T>]; GATES],
    c: &'a [Line<T>],
    dh: &'a [Line<T>],
    dc: &'a [Line<T>],
}

impl<T: Real> After<'_, T> {
    #[inline(always)]
    fn load<L: Lanes<Number = T>>(&self, l: L, row: usize, lane: usize) -> Loaded<L::Value> {
        let gates = self.z.map(
            #[inline(always)]
            |z| l.load(&z[row].0[lane..]),
        );
        let by = (l.load(&self.dh[row].0[lane..]), l.load(&self.dc[row].0[lane..]));
        (gates, l.load(&self.c[row].0[lane..]), by)
    }
}

/// The sums of a line of units' gates, for each event.
struct Sums<'a, T> {
    sums: &'a mut [Line<T>],
    summed: usize,
}

impl<T: Real> Sums<'_, T> {
    #[inline(always)]
    fn add<L: Lanes<Number = T>>(&mut self, l: L, event: usize, lane: usize, by: [L::Value; GATES]) {
        for gate in 0..GATES {
            let sum = &mut self.sums[gate * self.summed + event].0[lane..];
            l.store(sum, l.add(l.load(sum), by[gate]));
        }
    }
}

/// Inputs of a slice: a block's slice of 64 × 128 f32 stays in the first-level cache while rows pass over it.
const SLICE: usize = 128;

/// `dh_before = Wᵀ dz` of each row that went on.
#[derive(Debug)]
pub(super) struct ThroughWeights<'a, T> {
    /// The recurrent weights, from gates to units.
    pub(super) weights: &'a Arranged<T>,
    pub(super) dz: Lines<'a, T>,
    pub(super) later: usize,
    /// Takes the derivatives: lines of so many rows.
    pub(super) dh_before: &'a mut [Line<T>],
    pub(super) rows_before: usize,
}

impl<T: Real> Kernel<T> for ThroughWeights<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, l: L) {
        let Self { weights, dz, later, dh_before, rows_before } = self;
        for (terms, out) in weights.blocks().zip(dh_before.chunks_mut(BLOCK * rows_before)) {
            for (slice, terms) in terms.chunks(SLICE).enumerate() {
                let mut part = Part { terms, x: (dz, slice * SLICE / LINE), out, rows: rows_before };
                in_groups!(later, row => multiply::<L>(l, &mut part, row));
            }
        }
    }
}

/// A slice of a block of outputs.
struct Part<'a, 'o, T> {
    terms: &'a [Term<T>],
    x: (Lines<'a, T>, usize),
    out: &'o mut [Line<T>],
    rows: usize,
}

#[inline(always)]
fn multiply<L: Lanes, const N: usize>(l: L, part: &mut Part<'_, '_, L::Number>, row: usize) {
    let mut sums = [[Line::zero(); BLOCK]; N];
    let lines = part.out.len() / part.rows;
    if part.x.1 > 0 {
        for (line, out) in part.out.chunks_exact(part.rows).enumerate() {
            for n in 0..N {
                sums[n][line] = out[row + n];
            }
        }
    }
    add_products(l, part.terms, part.x, row, lines, &mut sums);
    for (line, out) in part.out.chunks_exact_mut(part.rows).enumerate() {
        for n in 0..N {
            out[row + n] = sums[n][line];
        }
    }
}
