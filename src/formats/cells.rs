//! One column's cells of a Parquet file, a chunk at a time.

use std::ops::Range;

use parquet::basic::{ConvertedType, LogicalType, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::errors::{ParquetError, Result};
use parquet::schema::types::ColumnDescriptor;

use super::FormatError;
use super::cell::{Cell, Run};
use super::columns::Role;
use super::excerpt::shortened;

/// One column of a row group.
pub(super) struct Column {
    reader: ColumnReader,
    role: Role,
    nullable: bool,
    cells: Cells,
}

/// The cells that were last read.
enum Cells {
    Numbers(Chunk<f64>),
    /// Numbers where text is wanted, as text.
    Ids(Chunk<String>),
    Texts(Chunk<ByteArray>),
}

/// Values of one type, one a row.
#[derive(Default)]
struct Chunk<V> {
    values: Vec<V>,
    /// Which of the values stand for none; empty where there are no such.
    missing: Vec<bool>,
}

impl Column {
    /// A column of `role`, which [`check`] has let through.
    pub(super) fn new(reader: ColumnReader, descriptor: &ColumnDescriptor, role: Role) -> Self {
        let cells = match reader {
            ColumnReader::ByteArrayColumnReader(_) => Cells::Texts(Chunk::default()),
            _ if role.is_number() => Cells::Numbers(Chunk::default()),
            _ => Cells::Ids(Chunk::default()),
        };
        Self { reader, role, nullable: descriptor.max_def_level() > 0, cells }
    }

    /// Reads the next `rows` cells.
    ///
    /// # Errors
    /// When the column has fewer, or cannot be read.
    pub(super) fn fill(&mut self, rows: usize) -> Result<()> {
        use ColumnReader as Reader;
        let nullable = self.nullable;
        match (&mut self.reader, &mut self.cells) {
            (Reader::DoubleColumnReader(reader), Cells::Numbers(chunk)) => chunk.fill(reader, rows, nullable, |x| x),
            (Reader::FloatColumnReader(reader), Cells::Numbers(chunk)) => chunk.fill(reader, rows, nullable, f64::from),
            (Reader::Int32ColumnReader(reader), Cells::Numbers(chunk)) => chunk.fill(reader, rows, nullable, f64::from),
            (Reader::Int64ColumnReader(reader), Cells::Numbers(chunk)) => {
                chunk.fill(reader, rows, nullable, |x| x as f64)
            }
            // As a double, whatever it was, since digits of a float are not those of its value.
            (Reader::FloatColumnReader(reader), Cells::Ids(chunk)) => {
                chunk.fill(reader, rows, nullable, |x| f64::from(x).to_string())
            }
            (Reader::DoubleColumnReader(reader), Cells::Ids(chunk)) => {
                chunk.fill(reader, rows, nullable, |x| x.to_string())
            }
            (Reader::Int32ColumnReader(reader), Cells::Ids(chunk)) => {
                chunk.fill(reader, rows, nullable, |x| x.to_string())
            }
            (Reader::Int64ColumnReader(reader), Cells::Ids(chunk)) => {
                chunk.fill(reader, rows, nullable, |x| x.to_string())
            }
            (Reader::ByteArrayColumnReader(reader), Cells::Texts(chunk)) => chunk.fill(reader, rows, nullable, |x| x),
            _ => Err(ParquetError::General("a column of a type that is not read".to_owned())),
        }
    }

    /// The cell of row `row` of what was last read.
    ///
    /// # Errors
    /// When it is text that is not UTF-8.
    pub(super) fn cell(&self, row: usize) -> Result<Cell<'_>> {
        Ok(match &self.cells {
            Cells::Numbers(chunk) => chunk.value(row).map_or(Cell::Missing, |&number| Cell::Number(number)),
            Cells::Ids(chunk) => chunk.value(row).map_or(Cell::Missing, |id| Cell::Text(id)),
            Cells::Texts(chunk) => match chunk.value(row).map(ByteArray::as_utf8).transpose()? {
                None | Some("") => Cell::Missing,
                Some(text) => Cell::Text(text),
            },
        })
    }

    /// The first row after `row` whose cell is another, of what was last read.
    pub(super) fn end_of_same(&self, row: usize) -> usize {
        match &self.cells {
            Cells::Numbers(chunk) => chunk.end_of_same(row, |a, b| a.to_bits() == b.to_bits()),
            Cells::Ids(chunk) => chunk.end_of_same(row, String::eq),
            // Of a column with a dictionary, cells that are the same are mostly the same bytes.
            Cells::Texts(chunk) => {
                chunk.end_of_same(row, |a, b| (a.data().as_ptr(), a.len()) == (b.data().as_ptr(), b.len()) || a == b)
            }
        }
    }

    /// The cells of `rows` together; none when they must be looked at one by one.
    ///
    /// # Errors
    /// When the first is text that is not UTF-8.
    pub(super) fn run(&self, rows: Range<usize>) -> Result<Option<Run<'_>>> {
        Ok(match &self.cells {
            Cells::Numbers(chunk) if self.role != Role::Dt => chunk.dense(rows).map(Run::Numbers),
            _ if self.end_of_same(rows.start) >= rows.end => Some(Run::Same(self.cell(rows.start)?)),
            _ => None,
        })
    }
}

impl<V: Default> Chunk<V> {
    fn fill<T: DataType>(
        &mut self,
        reader: &mut ColumnReaderImpl<T>,
        rows: usize,
        nullable: bool,
        value: impl Fn(T::T) -> V,
    ) -> Result<()> {
        let (mut levels, mut values) = (Vec::new(), Vec::with_capacity(rows));
        let (read, _, _) = reader.read_records(rows, nullable.then_some(&mut levels), None, &mut values)?;
        if read != rows {
            return Err(ParquetError::EOF(format!("a column has {read} of {rows} rows")));
        }
        let mut values = values.into_iter().map(value);
        self.missing.clear();
        if values.len() < rows && levels.len() == rows {
            self.missing.reserve(rows);
            self.values.clear();
            for level in levels {
                let present = if level > 0 { values.next() } else { None };
                self.missing.push(present.is_none());
                self.values.push(present.unwrap_or_default());
            }
        } else {
            self.values = values.collect();
        }
        if self.values.len() == rows {
            Ok(())
        } else {
            Err(ParquetError::General("levels and values differ".to_owned()))
        }
    }

    fn value(&self, row: usize) -> Option<&V> {
        (!self.is_missing(row)).then(|| &self.values[row])
    }

    fn is_missing(&self, row: usize) -> bool {
        self.missing.get(row).is_some_and(|&missing| missing)
    }

    fn end_of_same(&self, row: usize, same: impl Fn(&V, &V) -> bool) -> usize {
        let (first, missing) = (&self.values[row], self.is_missing(row));
        let differs = |&other: &usize| {
            if self.is_missing(other) { !missing } else { missing || !same(&self.values[other], first) }
        };
        (row + 1..self.values.len()).find(differs).unwrap_or(self.values.len())
    }

    fn dense(&self, rows: Range<usize>) -> Option<&[V]> {
        let some_missing = !self.missing.is_empty() && self.missing[rows.clone()].contains(&true);
        (!some_missing).then(|| &self.values[rows])
    }
}

/// Whether a column can be read as what its role needs.
///
/// # Errors
/// `wrong_type`, naming the column and its type.
pub(super) fn check(descriptor: &ColumnDescriptor, role: Role) -> std::result::Result<(), FormatError> {
    if role == Role::Ignored {
        return Ok(());
    }
    let plain_number = matches!(
        descriptor.converted_type(),
        ConvertedType::NONE
            | ConvertedType::INT_8
            | ConvertedType::INT_16
            | ConvertedType::INT_32
            | ConvertedType::INT_64
            | ConvertedType::UINT_8
            | ConvertedType::UINT_16
            | ConvertedType::UINT_32
    ) && matches!(descriptor.logical_type_ref(), None | Some(LogicalType::Integer(_)));
    let readable = match descriptor.physical_type() {
        Type::FLOAT | Type::DOUBLE => true,
        Type::INT32 | Type::INT64 => plain_number,
        Type::BYTE_ARRAY => !role.is_number() && descriptor.converted_type() != ConvertedType::DECIMAL,
        _ => false,
    };
    if readable && descriptor.max_rep_level() == 0 && descriptor.max_def_level() <= 1 {
        return Ok(());
    }
    let detail = format!(
        "column {} must hold {}, but is {} {:?}",
        shortened(&descriptor.path().string()),
        if role.is_number() { "numbers" } else { "text" },
        descriptor.physical_type(),
        descriptor.converted_type(),
    );
    Err(FormatError::invalid(None, "wrong_type", detail))
}
