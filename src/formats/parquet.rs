//! Parquet: one step a row.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::ops::Range;

use ::parquet::errors::ParquetError;
use ::parquet::file::reader::{ChunkReader, FileReader, Length, RowGroupReader, SerializedFileReader};
use bytes::Bytes;

use super::cells::{Column, check};
use super::columns::{Preset, Role};
use super::guarded::guarded;
use super::output::Output;
use super::table::Table;
use super::tables::table;
use super::{FormatError, FormatLimits, pages};
use crate::car_following::{Extraction, ExtractionSettings};
use crate::lineage::Place;

/// Rows read at once from each column.
const CHUNK_ROWS: usize = 4096;
const MAGIC: &[u8] = b"PAR1";

/// Decodes row group by row group, a chunk of rows at a time.
pub(super) fn decode(
    mut file: File,
    preset: Preset,
    extraction: &ExtractionSettings,
    output: &mut Output<'_, '_>,
) -> Result<Option<Extraction>, FormatError> {
    let limits = output.limits;
    whole(&mut file)?;
    let length = file.metadata().map_err(FormatError::Io)?.len();
    let look = file.try_clone().map_err(FormatError::Io)?;
    pages::footer(&look, length)?;
    let reader = guarded(|| SerializedFileReader::new(Bounded { file, length }))?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let paths: Vec<_> = schema.columns().iter().map(|column| column.path().string()).collect();
    let roles = preset.roles(paths.iter().map(String::as_str))?;
    for (descriptor, role) in schema.columns().iter().zip(&roles) {
        check(descriptor, *role)?;
    }
    bounded(&reader, limits)?;
    let wanted: Vec<_> = (0..roles.len()).filter(|&i| roles[i] != Role::Ignored).collect();
    let mut table = table(preset, wanted.iter().map(|&i| roles[i]).collect(), limits, extraction);
    let mut number = 1;
    for index in 0..reader.num_row_groups() {
        let group = guarded(|| reader.get_row_group(index))?;
        let mut columns = Vec::with_capacity(wanted.len());
        for &i in &wanted {
            let (start, length) = guarded(|| Ok(group.metadata().column(i).byte_range()))?;
            pages::bounded(&look, start, length, limits)?;
            let column = guarded(|| group.get_column_reader(i))?;
            columns.push(Column::new(column, &schema.columns()[i], roles[i]));
        }
        number = read_group(group.as_ref(), &mut columns, number, table.as_mut(), output)?;
    }
    table.end(output)
}

fn read_group(
    group: &dyn RowGroupReader,
    columns: &mut [Column],
    mut number: u64,
    table: &mut dyn Table,
    output: &mut Output<'_, '_>,
) -> Result<u64, FormatError> {
    let mut left = usize::try_from(group.metadata().num_rows())
        .map_err(|_| FormatError::malformed(None, &"a row group has a negative number of rows"))?;
    while left > 0 {
        let chunk = left.min(CHUNK_ROWS);
        for column in columns.iter_mut() {
            guarded(|| column.fill(chunk))?;
        }
        take_rows(columns, chunk, number, table, output)?;
        number += chunk as u64;
        left -= chunk;
    }
    Ok(number)
}

/// Hands on the `chunk` rows that the columns hold, the first of which is row `number`: those of an event together where
/// nothing has to be said of one of them alone, which is nearly always.
fn take_rows(
    columns: &[Column],
    chunk: usize,
    number: u64,
    table: &mut dyn Table,
    output: &mut Output<'_, '_>,
) -> Result<(), FormatError> {
    let malformed = |row: usize, error: ParquetError| FormatError::malformed(Place::Row(number + row as u64), &error);
    let one_by_one = |range: Range<usize>, table: &mut dyn Table, output: &mut Output<'_, '_>| {
        for row in range {
            let cells: Result<Vec<_>, _> = columns.iter().map(|column| column.cell(row)).collect();
            table.row(number + row as u64, &cells.map_err(|e| malformed(row, e))?, output)?;
        }
        Ok(())
    };
    let Some(id) = table.id_column().map(|id| &columns[id]) else { return one_by_one(0..chunk, table, output) };
    let mut row = 0;
    while row < chunk {
        let end = id.end_of_same(row);
        let runs: Result<Option<Vec<_>>, _> = columns.iter().map(|column| column.run(row..end)).collect();
        if let Some(runs) = runs.map_err(|e| malformed(row, e))? {
            table.run(number + row as u64, end - row, &runs, output)?;
        } else {
            one_by_one(row..end, table, output)?;
        }
        row = end;
    }
    Ok(())
}

/// Tells a file that was cut from one that never was Parquet.
fn whole(file: &mut File) -> Result<(), FormatError> {
    let length = file.seek(SeekFrom::End(0)).map_err(FormatError::Io)?;
    let mut ends = [0; 8];
    let (head, tail) = ends.split_at_mut(4);
    let mut read = |from, into: &mut [u8]| {
        file.seek(SeekFrom::Start(from)).and_then(|_| file.read_exact(into)).map_err(FormatError::Io)
    };
    if length >= 12 {
        read(0, head)?;
        read(length - 4, tail)?;
    }
    match (head == MAGIC, tail == MAGIC) {
        (true, true) => Ok(()),
        (true, false) => Err(FormatError::Truncated { detail: "the file has no Parquet footer".to_owned() }),
        _ if length < 12 => Err(FormatError::Truncated { detail: format!("{length} bytes are no Parquet file") }),
        _ => Err(FormatError::malformed(None, &"the file does not begin as Parquet does")),
    }
}

/// What the file says it holds must be within the limits before any of it is read: a few bytes can stand for
/// thousands of millions of rows.
fn bounded(reader: &SerializedFileReader<Bounded>, limits: &FormatLimits) -> Result<(), FormatError> {
    let mut total: u64 = 0;
    for group in reader.metadata().row_groups() {
        let cells = u64::try_from(group.num_rows()).unwrap_or(u64::MAX).saturating_mul(8 * group.num_columns() as u64);
        let said: u64 = group.columns().iter().map(|c| u64::try_from(c.uncompressed_size()).unwrap_or(0)).sum();
        total = total.saturating_add(cells.max(said));
    }
    if total > limits.max_decompressed_bytes {
        let detail =
            format!("the file holds {total} bytes uncompressed, at most {} are read", limits.max_decompressed_bytes);
        return Err(FormatError::TooLarge { code: "body_too_large", detail });
    }
    Ok(())
}

/// A file from which no more is asked than it holds: the library allocates what a file's metadata says.
struct Bounded {
    file: File,
    length: u64,
}

impl Bounded {
    fn within(&self, start: u64, length: u64) -> Result<(), ParquetError> {
        match start.checked_add(length) {
            Some(end) if end <= self.length => Ok(()),
            _ => Err(ParquetError::EOF(format!("bytes {start} to {start} + {length} of {} are missing", self.length))),
        }
    }
}

impl Length for Bounded {
    fn len(&self) -> u64 {
        self.length
    }
}

impl ChunkReader for Bounded {
    type T = BufReader<File>;

    fn get_read(&self, start: u64) -> Result<Self::T, ParquetError> {
        self.within(start, 0)?;
        self.file.get_read(start)
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        self.within(start, length as u64)?;
        self.file.get_bytes(start, length)
    }
}
