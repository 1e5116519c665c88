//! Event files, as an upload takes them: the format by the file's name, the columns by theirs.

use std::ffi::OsStr;
use std::fs::File;
use std::ops::ControlFlow;
use std::path::Path;

use anyhow::bail;

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
    match read_as(path, format, Preset::Headway) {
        Err(Unread::Body(FormatError::Invalid { code: "unknown_column" | "missing_column", detail, .. })) => {
            // Neither preset knows the columns: what the first one says tells what they should be.
            read_as(path, format, Preset::Follownet).map_err(|other| match other {
                Unread::Body(FormatError::Invalid {
                    code: "unknown_column" | "missing_column", detail: other, ..
                }) => {
                    anyhow::anyhow!("{detail}; {other}")
                }
                other => other.into(),
            })
        }
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
    #[error(transparent)]
    Body(#[from] FormatError),
}

fn read_as(path: &Path, format: Format, preset: Preset) -> Result<Vec<Result<RawEvent, Rejection>>, Unread> {
    let kind = BodyKind { format, encoding: Encoding::Identity, preset };
    let mut contents = Vec::new();
    decode(File::open(path)?, kind, &FormatLimits::default(), &mut |decoded| {
        contents.push(decoded);
        ControlFlow::Continue(())
    })?;
    Ok(contents)
}
