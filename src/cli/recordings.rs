//! Event files, as an upload takes them: the format by the file's name, the columns by theirs.

use std::ffi::OsStr;
use std::fs::File;
use std::ops::ControlFlow;
use std::path::Path;

use anyhow::{bail, ensure};

use crate::car_following::ExtractionSettings;
use crate::formats::{BodyKind, Encoding, Format, FormatError, FormatLimits, Preset, RawEvent, decode};
use crate::lineage::Rejection;

/// Everything in a file: each event as it was recorded, or why it could not be read.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<Result<RawEvent, Rejection>>> {
    let format = match path.extension().and_then(OsStr::to_str) {
        Some("parquet") => Format::Parquet,
        Some("csv") => Format::Csv,
        Some("json") => Format::Json,
        Some("ndjson") => Format::Ndjson,
        _ => bail!("its name ends in none of .parquet, .csv, .json and .ndjson"),
    };
    ensure!(std::fs::metadata(path)?.len() > 0, "it is empty");
    let first = match read_as(path, format, Preset::Headway) {
        Err(Unread::Columns(first)) => first,
        read => return Ok(read?),
    };
    match read_as(path, format, Preset::Follownet) {
        // A preset that knows all the columns is the one that was meant.
        Err(Unread::Columns(second)) => match (first.code(), second.code()) {
            ("missing_column", "unknown_column") => bail!(first),
            ("unknown_column", "missing_column") => bail!(second),
            _ => bail!("{first}; {second}"),
        },
        read => Ok(read?),
    }
}

/// The name that events of a file have as their source when they name none.
pub(super) fn source_name(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}

#[derive(Debug, thiserror::Error)]
enum Unread {
    #[error(transparent)]
    File(#[from] std::io::Error),
    /// The preset has other ones.
    #[error(transparent)]
    Columns(FormatError),
    #[error(transparent)]
    Body(FormatError),
}

impl From<FormatError> for Unread {
    fn from(error: FormatError) -> Self {
        if matches!(error.code(), "unknown_column" | "missing_column") {
            Self::Columns(error)
        } else {
            Self::Body(error)
        }
    }
}

fn read_as(path: &Path, format: Format, preset: Preset) -> Result<Vec<Result<RawEvent, Rejection>>, Unread> {
    let kind = BodyKind { format, encoding: Encoding::Identity, preset };
    let mut contents = Vec::new();
    let (limits, extraction) = (FormatLimits::default(), ExtractionSettings::default());
    decode(File::open(path)?, kind, &limits, &extraction, &mut |decoded| {
        contents.push(decoded);
        ControlFlow::Continue(())
    })?;
    Ok(contents)
}
