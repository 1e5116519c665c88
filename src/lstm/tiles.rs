//! Matrices like the recurrent weights, in tiles that fit into registers: some pre-activations by some units.

use super::Real;
use super::lanes::Lanes;
use super::lines::LINE;

/// Pre-activations of a tile: a part of a line.
pub(super) const OUTPUTS: usize = 8;
/// Lines of units of a tile, where a line is one vector.
pub(super) const TOGETHER: usize = 2;

/// Where the value of a line of units lies: those of all pre-activations beside each other, so that tiles are read in one
/// stretch.
#[inline(always)]
pub(super) fn place(outputs: usize, output: usize, line: usize) -> usize {
    (line / TOGETHER * outputs + output) * TOGETHER + line % TOGETHER
}

/// A computation tile by tile.
pub(super) trait Tiles<T: Real> {
    /// [`OUTPUTS`] pre-activations from `from` on of a line of them, by `G` lines of units from line `at` on: one vector of each,
    /// from `lane` on.
    fn tile<L: Lanes<Number = T>, const G: usize>(&mut self, l: L, of: (usize, usize), by: (usize, usize));
}

/// Computes every tile. Units of two lines stay in the first-level cache while all pre-activations pass over them.
#[inline(always)]
pub(super) fn each_tile<L: Lanes>(l: L, outputs: usize, lines: usize, tiles: &mut impl Tiles<L::Number>) {
    for at in (0..lines).step_by(TOGETHER) {
        for output in 0..outputs / LINE {
            for from in (0..LINE).step_by(OUTPUTS) {
                if L::WIDTH == LINE && at + TOGETHER <= lines {
                    tiles.tile::<L, TOGETHER>(l, (output, from), (at, 0));
                    continue;
                }
                for line in at..lines.min(at + TOGETHER) {
                    for lane in (0..LINE).step_by(L::WIDTH) {
                        tiles.tile::<L, 1>(l, (output, from), (line, lane));
                    }
                }
            }
        }
    }
}

/// `sums += dz hᵀ` of one row.
#[inline(always)]
pub(super) fn add_outer<L: Lanes, const G: usize>(
    l: L,
    dz: &[L::Number; OUTPUTS],
    h: [L::Value; G],
    sums: &mut [[L::Value; G]; OUTPUTS],
) {
    for n in 0..OUTPUTS {
        let dz = l.splat(dz[n]);
        for g in 0..G {
            sums[n][g] = l.fma(dz, h[g], sums[n][g]);
        }
    }
}
