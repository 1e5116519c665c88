//! Cells in row groups, one a piece, compressed with Snappy.

use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

use ::parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use ::parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use ::parquet::errors::ParquetError;
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use ::parquet::schema::types::Type;

use super::{Cells, Sheet};

/// What was written since it was last taken.
#[derive(Debug, Clone, Default)]
struct Written(Arc<Mutex<Vec<u8>>>);

impl Written {
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Written {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A file that is being written.
pub(super) struct Writer {
    file: SerializedFileWriter<Written>,
    written: Written,
}

impl Writer {
    pub(super) fn new(first: &Sheet) -> io::Result<Self> {
        let fields: Result<Vec<_>, _> = first.columns.iter().map(|(name, cells)| field(name, cells)).collect();
        let fields = fields.map_err(io::Error::other)?;
        let schema = Type::group_type_builder("schema").with_fields(fields).build().map_err(io::Error::other)?;
        let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
        let written = Written::default();
        let file = SerializedFileWriter::new(written.clone(), Arc::new(schema), Arc::new(properties));
        Ok(Self { file: file.map_err(io::Error::other)?, written })
    }

    pub(super) fn write(&mut self, sheet: &Sheet) -> io::Result<Vec<u8>> {
        self.group(sheet).map_err(io::Error::other)?;
        Ok(self.written.take())
    }

    fn group(&mut self, sheet: &Sheet) -> Result<(), ParquetError> {
        let mut group = self.file.next_row_group()?;
        for (_, cells) in &sheet.columns {
            match cells {
                Cells::Text(cells) => {
                    let bytes = |cell: &Arc<str>| ByteArray::from(cell.as_bytes().to_vec());
                    optional::<ByteArrayType, _>(&mut group, cells, bytes)?;
                }
                Cells::Whole(cells) => optional::<Int64Type, _>(&mut group, cells, |cell| *cell)?,
                Cells::Number(cells) => optional::<DoubleType, _>(&mut group, cells, |cell| *cell)?,
                Cells::Single(cells) => column::<FloatType>(&mut group, cells, None)?,
            }
        }
        group.close().map(drop)
    }

    pub(super) fn end(self) -> io::Result<Vec<u8>> {
        self.file.close().map_err(io::Error::other)?;
        Ok(self.written.take())
    }
}

fn field(name: &str, cells: &Cells) -> Result<Arc<Type>, ParquetError> {
    let (physical, logical, repetition) = match cells {
        Cells::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String), Repetition::OPTIONAL),
        Cells::Whole(_) => (Physical::INT64, None, Repetition::OPTIONAL),
        Cells::Number(_) => (Physical::DOUBLE, None, Repetition::OPTIONAL),
        Cells::Single(_) => (Physical::FLOAT, None, Repetition::REQUIRED),
    };
    let builder = Type::primitive_type_builder(name, physical).with_repetition(repetition);
    builder.with_logical_type(logical).build().map(Arc::new)
}

fn optional<T: DataType, C>(
    group: &mut SerializedRowGroupWriter<'_, Written>,
    cells: &[Option<C>],
    value: impl Fn(&C) -> T::T,
) -> Result<(), ParquetError> {
    let levels: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    let values: Vec<T::T> = cells.iter().flatten().map(value).collect();
    column::<T>(group, &values, Some(&levels))
}

fn column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, Written>,
    values: &[T::T],
    levels: Option<&[i16]>,
) -> Result<(), ParquetError> {
    let missing = || ParquetError::General("a column is missing".to_owned());
    let mut column = group.next_column()?.ok_or_else(missing)?;
    column.typed::<T>().write_batch(values, levels, None)?;
    column.close()
}
