//! Tables that are handed out, as CSV and Parquet: columns of the same length, written piece by piece.

/// Cells as text.
mod csv;
/// Stored events as rows and lines.
mod events;
/// Cells in row groups.
mod parquet;

use std::io;
use std::sync::Arc;

pub use events::EventWriter;

/// The cells of a column; where there may be none, none is an empty cell or a null.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Text.
    Text(Vec<Option<Arc<str>>>),
    /// Whole numbers.
    Whole(Vec<Option<i64>>),
    /// Numbers.
    Number(Vec<Option<f64>>),
    /// Numbers as they are stored, one in every row.
    Single(Vec<f32>),
}

/// Some rows of a table.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sheet {
    columns: Vec<(&'static str, Cells)>,
}

impl Sheet {
    /// One column more.
    #[must_use]
    pub fn with(mut self, name: &'static str, cells: Cells) -> Self {
        debug_assert!(self.columns.is_empty() || self.rows() == cells.len(), "columns are of the same length");
        self.columns.push((name, cells));
        self
    }

    /// How many rows there are.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, cells)| cells.len())
    }
}

impl Cells {
    fn len(&self) -> usize {
        match self {
            Self::Text(cells) => cells.len(),
            Self::Whole(cells) => cells.len(),
            Self::Number(cells) => cells.len(),
            Self::Single(cells) => cells.len(),
        }
    }
}

/// How a table is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SheetFormat {
    /// Under a header.
    Csv,
    /// A row group a piece.
    Parquet,
}

/// Writes a table piece by piece; every piece has the same columns.
enum SheetWriter {
    /// Whether the header is written.
    Csv(bool),
    /// With what was written last.
    Parquet(Box<parquet::Writer>),
}

impl std::fmt::Debug for SheetWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Csv(_) => "SheetWriter::Csv",
            Self::Parquet(_) => "SheetWriter::Parquet",
        })
    }
}

impl SheetWriter {
    /// Of a table with the columns of `first`, whose rows are not written yet.
    fn new(format: SheetFormat, first: &Sheet) -> io::Result<Self> {
        Ok(match format {
            SheetFormat::Csv => Self::Csv(false),
            SheetFormat::Parquet => Self::Parquet(Box::new(parquet::Writer::new(first)?)),
        })
    }

    /// The bytes of these rows.
    fn write(&mut self, sheet: &Sheet) -> io::Result<Vec<u8>> {
        match self {
            Self::Csv(begun) => csv::bytes(sheet, !std::mem::replace(begun, true)),
            Self::Parquet(writer) => writer.write(sheet),
        }
    }

    /// The last bytes.
    fn end(self) -> io::Result<Vec<u8>> {
        match self {
            Self::Csv(_) => Ok(Vec::new()),
            Self::Parquet(writer) => writer.end(),
        }
    }
}

/// A table that is in memory as a whole.
///
/// # Errors
/// When it cannot be written.
pub fn whole_sheet(format: SheetFormat, sheet: &Sheet) -> io::Result<Vec<u8>> {
    let mut writer = SheetWriter::new(format, sheet)?;
    let mut bytes = writer.write(sheet)?;
    bytes.extend(writer.end()?);
    Ok(bytes)
}
