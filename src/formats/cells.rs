//! One column's cells of a Parquet file, a chunk at a time.

use parquet::basic::{ConvertedType, LogicalType, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::errors::{ParquetError, Result};
use parquet::schema::types::ColumnDescriptor;

use super::FormatError;
use super::columns::Role;
use super::draft::shortened;
use super::rows::Cell;

/// One column of a row group.
pub(super) struct Column {
    reader: ColumnReader,
    nullable: bool,
    cells: Vec<Value>,
}

/// A value as it is in the file.
enum Value {
    Null,
    Number(f64),
    Id(String),
    Text(ByteArray),
}

impl Column {
    /// A column of `role`, which [`check`] has let through.
    pub(super) fn new(reader: ColumnReader, descriptor: &ColumnDescriptor) -> Self {
        Self { reader, nullable: descriptor.max_def_level() > 0, cells: Vec::new() }
    }

    /// Reads the next `rows` cells.
    ///
    /// # Errors
    /// When the column has fewer, or cannot be read.
    pub(super) fn fill(&mut self, rows: usize, role: Role) -> Result<()> {
        let (nullable, cells) = (self.nullable, &mut self.cells);
        cells.clear();
        let number = role.is_number();
        match &mut self.reader {
            ColumnReader::FloatColumnReader(reader) => {
                fill(reader, rows, nullable, cells, |x| decimal(x.into(), number))
            }
            ColumnReader::DoubleColumnReader(reader) => fill(reader, rows, nullable, cells, |x| decimal(x, number)),
            ColumnReader::Int32ColumnReader(reader) => fill(reader, rows, nullable, cells, |x| whole(x.into(), number)),
            ColumnReader::Int64ColumnReader(reader) => fill(reader, rows, nullable, cells, |x| whole(x, number)),
            ColumnReader::ByteArrayColumnReader(reader) => fill(reader, rows, nullable, cells, Value::Text),
            _ => Err(ParquetError::General("a column of a type that is not read".to_owned())),
        }
    }

    /// The cell of row `row` of what was last read.
    ///
    /// # Errors
    /// When it is text that is not UTF-8.
    pub(super) fn cell(&self, row: usize) -> Result<Cell<'_>> {
        Ok(match &self.cells[row] {
            Value::Null => Cell::Missing,
            Value::Number(number) => Cell::Number(*number),
            Value::Id(id) => Cell::Text(id),
            Value::Text(text) => match text.as_utf8()? {
                "" => Cell::Missing,
                text => Cell::Text(text),
            },
        })
    }
}

fn decimal(value: f64, number: bool) -> Value {
    if number { Value::Number(value) } else { Value::Id(value.to_string()) }
}

fn whole(value: i64, number: bool) -> Value {
    if number { Value::Number(value as f64) } else { Value::Id(value.to_string()) }
}

fn fill<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    nullable: bool,
    cells: &mut Vec<Value>,
    value: impl Fn(T::T) -> Value,
) -> Result<()> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    let (read, _, _) = reader.read_records(rows, nullable.then_some(&mut levels), None, &mut values)?;
    if read != rows {
        return Err(ParquetError::EOF(format!("a column has {read} of {rows} rows")));
    }
    if nullable {
        let mut values = values.into_iter();
        let present = |level: i16| if level > 0 { values.next().map_or(Value::Null, &value) } else { Value::Null };
        cells.extend(levels.into_iter().map(present));
    } else {
        cells.extend(values.into_iter().map(value));
    }
    if cells.len() == rows { Ok(()) } else { Err(ParquetError::General("levels and values differ".to_owned())) }
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
