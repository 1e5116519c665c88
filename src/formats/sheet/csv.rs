//! Cells as text: numbers with as few digits as name them, quotes where they are needed.

use std::io;

use ::csv::WriterBuilder;

use super::{Cells, Sheet};

/// The rows, under the names of their columns if it is asked for.
pub(super) fn bytes(sheet: &Sheet, with_header: bool) -> io::Result<Vec<u8>> {
    let mut writer = WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    if with_header {
        writer.write_record(sheet.columns.iter().map(|(name, _)| name))?;
    }
    for row in 0..sheet.rows() {
        for (_, cells) in &sheet.columns {
            match cells {
                Cells::Text(cells) => writer.write_field(cells[row].as_deref().unwrap_or_default())?,
                Cells::Whole(cells) => writer.write_field(told(cells[row]))?,
                Cells::Number(cells) => writer.write_field(told(cells[row]))?,
                Cells::Single(cells) => writer.write_field(format!("{:?}", cells[row]))?,
            }
        }
        writer.write_record(None::<&[u8]>)?;
    }
    writer.into_inner().map_err(::csv::IntoInnerError::into_error)
}

fn told<T: std::fmt::Debug>(cell: Option<T>) -> String {
    cell.map_or_else(String::new, |cell| format!("{cell:?}"))
}
