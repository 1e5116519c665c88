//! CSV: one step a row, under a header; of a whole road, one vehicle at one time.

use std::io::BufRead;

use ::csv::{ByteRecord, ErrorKind, ReaderBuilder};

use super::FormatError;
use super::cell::Cell;
use super::columns::{Preset, ROLES, Role};
use super::output::Output;
use super::source::Budget;
use super::tables::table;
use crate::car_following::{Extraction, ExtractionSettings};
use crate::lineage::Place;

/// Decodes row by row. A row with other cells than the header refuses its event, or the recording of a road; at the end of the
/// body a row with fewer means that the body was cut.
pub(super) fn decode(
    reader: Box<dyn BufRead>,
    budget: &Budget,
    preset: Preset,
    extraction: &ExtractionSettings,
    output: &mut Output<'_, '_>,
) -> Result<Option<Extraction>, FormatError> {
    let delimiter = if preset == Preset::Fcd { b';' } else { b',' };
    let mut reader = ReaderBuilder::new().has_headers(false).flexible(true).delimiter(delimiter).from_reader(reader);
    let mut record = ByteRecord::new();
    if !next(&mut reader, &mut record, budget)? {
        return Err(FormatError::Truncated { detail: "there is no header".to_owned() });
    }
    let mut names = Vec::with_capacity(record.len());
    for name in &record {
        names.push(text(name, None)?.to_owned());
    }
    let roles = preset.roles(names.iter().map(String::as_str))?;
    let wanted: Vec<_> = (0..roles.len()).filter(|&i| roles[i] != Role::Ignored).collect();
    let mut table = table(preset, wanted.iter().map(|&i| roles[i]).collect(), output.limits, extraction);
    let mut following = ByteRecord::new();
    let mut more = next(&mut reader, &mut record, budget)?;
    for number in 1.. {
        if !more {
            break;
        }
        let found = record.len();
        let mut cells = [Cell::Missing; ROLES];
        for (cell, &i) in cells.iter_mut().zip(&wanted) {
            *cell = read(record.get(i).unwrap_or_default(), number)?;
        }
        let mut taken = table.row(number, &cells[..wanted.len()], output);
        if found != roles.len() {
            taken = taken.and_then(|()| table.ragged(number, found, roles.len()));
        }
        more = next(&mut reader, &mut following, budget)?;
        if found < roles.len() && !more {
            let detail = format!("row {number}, the last, has {found} of {} cells", roles.len());
            return Err(FormatError::Truncated { detail });
        }
        taken?;
        std::mem::swap(&mut record, &mut following);
    }
    table.end(output)
}

fn next(
    reader: &mut ::csv::Reader<Box<dyn BufRead>>,
    record: &mut ByteRecord,
    budget: &Budget,
) -> Result<bool, FormatError> {
    budget.next_event();
    reader.read_byte_record(record).map_err(|error| match error.into_kind() {
        ErrorKind::Io(error) => error.into(),
        other => FormatError::malformed(None, &format!("{other:?}")),
    })
}

fn text(cell: &[u8], row: Option<u64>) -> Result<&str, FormatError> {
    std::str::from_utf8(cell)
        .map(str::trim)
        .map_err(|_| FormatError::malformed(row.map(Place::Row), &"CSV must be UTF-8, and a cell is not"))
}

fn read(cell: &[u8], row: u64) -> Result<Cell<'_>, FormatError> {
    Ok(match text(cell, Some(row))? {
        "" => Cell::Missing,
        text => Cell::Text(text),
    })
}
