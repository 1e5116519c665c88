//! Bodies into raw events, one at a time: bounded memory whatever the length of the body. And stored events, like other tables,
//! into bodies.
//!
//! An event that cannot be read is a `Rejection` and the next one follows; a body that cannot be read is a
//! [`FormatError`](crate::formats::FormatError) and nothing of it counts.

/// What tables have in their rows.
mod cell;
/// One column's cells of a Parquet file, a chunk at a time.
mod cells;
/// Columns by name: presets and the roles their columns play.
mod columns;
/// CSV: one step a row.
mod csv;
/// An event while it is being read.
mod draft;
/// What makes a whole body unusable.
mod error;
/// Quoting a body in a message without quoting all of it.
mod excerpt;
/// Code of libraries that may panic.
mod guarded;
/// JSON: a document with `events`.
mod json;
/// One JSON event, read so that a bad value rejects the event and not the body.
mod json_event;
/// Most bytes, steps and events.
mod limits;
/// Content types and encodings.
mod media;
/// NDJSON: one event a line.
mod ndjson;
/// `NumPy`'s arrays, as `FollowNet` has them.
mod npy;
/// Where decoded events go.
mod output;
/// What Parquet files say of themselves, looked at first.
mod pages;
/// Parquet: one step a row.
mod parquet;
/// A decoded event, and where it was.
mod raw;
/// Rows of one event into that event.
mod rows;
/// Recordings of a whole road, out of which events are extracted.
mod scene;
/// Tables that are handed out.
mod sheet;
/// The body's bytes: decompressed, counted.
mod source;
/// What the rows of a tabular body become.
mod table;
/// Which table the rows of a body are for.
mod tables;
/// The protocol in which Parquet files speak of themselves.
mod thrift;

use std::fs::File;

pub use columns::Preset;
pub use error::FormatError;
pub use excerpt::excerpt;
pub use guarded::is_guarded;
pub use limits::{FormatLimits, FormatLimitsError};
pub use media::{Encoding, Format};
pub use output::Sink;
pub use raw::{Origin, RawEvent};
pub use sheet::{Cells, EventWriter, Sheet, SheetFormat, whole_sheet};

use crate::car_following::{Extraction, ExtractionSettings};

/// What a body is said to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BodyKind {
    /// Its content type.
    pub format: Format,
    /// Its content encoding.
    pub encoding: Encoding,
    /// The columns of a tabular body.
    pub preset: Preset,
}

/// Decodes the body in `file` from its beginning, giving each event or rejection to `sink` in order. A body may well
/// hold none of either. Out of a recording of a whole road, events are extracted by the criteria of `extraction`; what became
/// of its rows is given back.
///
/// # Errors
/// When the body as a whole cannot be used. What `sink` was given before then is to be forgotten.
pub fn decode(
    file: File,
    kind: BodyKind,
    limits: &FormatLimits,
    extraction: &ExtractionSettings,
    sink: &mut Sink<'_>,
) -> Result<Option<Extraction>, FormatError> {
    kind.preset.check(kind.format)?;
    let mut output = output::Output::new(limits, sink);
    let (file, budget) = source::open(file, limits)?;
    let text = |file| source::decompress(file, kind.encoding, &budget);
    match kind.format {
        Format::Json => json::decode(text(file)?, &budget, &mut output).map(|()| None),
        Format::Ndjson => ndjson::decode(text(file)?, &budget, &mut output).map(|()| None),
        Format::Csv => csv::decode(text(file)?, &budget, kind.preset, extraction, &mut output),
        Format::Npy => npy::decode(text(file)?, &budget, &mut output).map(|()| None),
        Format::Xml => scene::decode(text(file)?, &budget, extraction, &mut output).map(Some),
        Format::Parquet => {
            let file = source::seekable(file, kind.encoding, &budget)?;
            parquet::decode(file, kind.preset, extraction, &mut output)
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
