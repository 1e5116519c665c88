//! What a Parquet file's footer and pages say is looked at before its reader believes it: it allocates what a page says, and
//! takes as long as a footer says.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};

use super::thrift::{FILE, PAGE, Reader};
use super::{FormatError, FormatLimits};

/// Of the end of a file: the length of its footer, and that it is Parquet.
const TAIL_BYTES: u64 = 8;

/// Encodings in which a few bytes of a page say how much is allocated, and nothing before the page is decoded tells how few
/// they are: the process would end.
const UNREAD: [i64; 2] = [6, 7];
/// Least bytes of a value in a dictionary.
const LEAST_BYTES: u64 = 4;

/// Looks at the footer of a file of `length` bytes, which ends as Parquet does.
///
/// # Errors
/// When it cannot be read.
pub(super) fn footer(file: &File, length: u64) -> Result<(), FormatError> {
    let mut file = BufReader::new(file);
    let mut tail = [0; TAIL_BYTES as usize];
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL_BYTES))).map_err(FormatError::Io)?;
    file.read_exact(&mut tail).map_err(FormatError::Io)?;
    let [a, b, c, d, ..] = tail;
    let bytes = u64::from(u32::from_le_bytes([a, b, c, d]));
    let Some(start) = length.checked_sub(TAIL_BYTES + bytes) else {
        return Err(FormatError::Truncated { detail: format!("a footer of {bytes} bytes does not fit into the file") });
    };
    file.seek(SeekFrom::Start(start)).map_err(FormatError::Io)?;
    Reader::new(file.take(bytes)).walk(FILE, &mut |_, _| ())
}

/// Looks at every page's header in `length` bytes from `start`, which are a column's.
///
/// # Errors
/// `body_too_large` when a page is larger uncompressed than [`FormatLimits::max_page_bytes`]; `encoding_not_read`; when a
/// header cannot be read.
pub(super) fn bounded(file: &File, start: u64, length: u64, limits: &FormatLimits) -> Result<(), FormatError> {
    let end = start.saturating_add(length);
    let mut file = BufReader::with_capacity(512, file);
    let mut at = start;
    file.seek(SeekFrom::Start(start)).map_err(FormatError::Io)?;
    while at < end {
        let mut header = Reader::new((&mut file).take(end - at));
        let (mut uncompressed, mut compressed, mut values) = (-1, -1, 0);
        let mut encodings = [0; 2];
        header.walk(PAGE, &mut |field, value| match field {
            2 => uncompressed = value,
            3 => compressed = value,
            502 => encodings[0] = value,
            701 => values = value,
            804 => encodings[1] = value,
            _ => {}
        })?;
        let uncompressed = u64::try_from(uncompressed).unwrap_or(u64::MAX);
        if uncompressed > limits.max_page_bytes {
            let detail =
                format!("a page is {uncompressed} bytes uncompressed, at most {} are read", limits.max_page_bytes);
            return Err(FormatError::TooLarge { code: "body_too_large", detail });
        }
        if encodings.iter().any(|encoding| UNREAD.contains(encoding)) {
            let detail =
                "pages in DELTA_LENGTH_BYTE_ARRAY and DELTA_BYTE_ARRAY are not read; PLAIN and dictionaries are";
            return Err(FormatError::invalid(None, "encoding_not_read", detail.to_owned()));
        }
        if u64::try_from(values).is_ok_and(|values| values > uncompressed / LEAST_BYTES) {
            return Err(FormatError::malformed(None, &"a dictionary has fewer values than it says"));
        }
        let compressed = u32::try_from(compressed)
            .map_err(|_| FormatError::malformed(None, &"a page does not say how long it is"))?;
        at += header.read + u64::from(compressed);
        file.seek_relative(compressed.into()).map_err(FormatError::Io)?;
    }
    Ok(())
}
