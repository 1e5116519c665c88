//! What the rows of a tabular body become: steps of events one after another, or a whole road.

use super::FormatError;
use super::cell::{Cell, Run};
use super::output::Output;
use crate::car_following::Extraction;

/// Takes rows, and gives events to the output.
pub(super) trait Table {
    /// The column whose equal cells make consecutive rows one event, which [`Self::run`] takes together; none where rows are
    /// taken one by one.
    fn id_column(&self) -> Option<usize> {
        None
    }

    /// Takes row `number`, one cell a column.
    fn row(&mut self, number: u64, cells: &[Cell<'_>], output: &mut Output<'_, '_>) -> Result<(), FormatError>;

    /// Takes `length` rows of one event, the first of which is row `number`, as [`Self::row`] would one after another.
    fn run(
        &mut self,
        number: u64,
        length: usize,
        columns: &[Run<'_>],
        output: &mut Output<'_, '_>,
    ) -> Result<(), FormatError> {
        for row in 0..length {
            let cells: Vec<_> = columns.iter().map(|column| column.cell(row)).collect();
            self.row(number + row as u64, &cells, output)?;
        }
        Ok(())
    }

    /// Row `number`, the last that was taken, has other cells than the header.
    fn ragged(&mut self, number: u64, found: usize, wanted: usize) -> Result<(), FormatError>;

    /// The body has ended; what was extracted, where the rows were those of a road.
    fn end(self: Box<Self>, output: &mut Output<'_, '_>) -> Result<Option<Extraction>, FormatError>;
}
