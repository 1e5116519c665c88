//! Values in whole lines of the cache, in the order in which training reads them.

use super::Real;

/// Neighbouring values that are computed together: as many as a line of the cache, or the widest register, holds.
pub(super) const LINE: usize = 16;
/// Input, forget, cell and output gate.
pub(super) const GATES: usize = 4;

/// One value for each of some neighbouring units, of one row. Beyond the last unit they are 0.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Line<T>(pub(super) [T; LINE]);

impl<T: Real> Line<T> {
    /// Zeros.
    #[inline(always)]
    pub(super) fn zero() -> Self {
        Self([T::zero(); LINE])
    }
}

/// Rows of values, line by line: the first line of every row, then the second of every row. Rows that are computed together
/// are read in one stretch, and the first rows of a step are those of a shorter one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lines<'a, T> {
    values: &'a [Line<T>],
    rows: usize,
}

impl<'a, T> Lines<'a, T> {
    /// `values` of so many rows.
    #[inline(always)]
    pub(super) fn new(values: &'a [Line<T>], rows: usize) -> Self {
        Self { values, rows }
    }

    /// This line of every row.
    #[inline(always)]
    pub(super) fn line(self, line: usize) -> &'a [Line<T>] {
        &self.values[line * self.rows..][..self.rows]
    }
}

/// At least this long; what is there stays.
pub(super) fn grow<T: Real>(buffer: &mut Vec<Line<T>>, len: usize) {
    if buffer.len() < len {
        buffer.resize(len, Line::zero());
    }
}

/// Lines that hold a value for each unit.
pub(super) fn lines(hidden: usize) -> usize {
    hidden.div_ceil(LINE)
}

/// The row of the weights (torch's order: all units of a gate beside each other) of a pre-activation in the order of lines: the
/// four gates of a line's units beside each other, input gate first. None beyond the last unit.
pub(super) fn gate_row(hidden: usize, at: usize) -> Option<usize> {
    let (block, gate, lane) = (at / (GATES * LINE), at / LINE % GATES, at % LINE);
    let unit = block * LINE + lane;
    (unit < hidden).then_some(gate * hidden + unit)
}

/// The value of each unit, in lines.
pub(super) fn in_lines<T: Real>(values: &[T]) -> impl Iterator<Item = Line<T>> + '_ {
    values.chunks(LINE).map(|part| {
        let mut line = Line::zero();
        line.0[..part.len()].copy_from_slice(part);
        line
    })
}
