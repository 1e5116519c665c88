//! How large the pages of a Parquet file say they are: its reader allocates that much before it reads any of it.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use super::{FormatError, FormatLimits};

/// Structures within structures of a page's header; those of the format are three deep.
const DEPTH: u32 = 8;

/// Looks at every page's header in `length` bytes from `start`, which are a column's.
///
/// # Errors
/// `body_too_large` when a page is larger uncompressed than [`FormatLimits::max_page_bytes`]; when a header cannot be read.
pub(super) fn bounded(file: &File, start: u64, length: u64, limits: &FormatLimits) -> Result<(), FormatError> {
    let end = start.saturating_add(length);
    let mut file = BufReader::with_capacity(512, file);
    let mut at = start;
    file.seek(SeekFrom::Start(start)).map_err(FormatError::Io)?;
    while at < end {
        let mut header = Header { bytes: (&mut file).take(end - at), read: 0 };
        let page = header.sizes()?;
        let uncompressed = u64::try_from(page.uncompressed).unwrap_or(u64::MAX);
        if uncompressed > limits.max_page_bytes {
            let detail =
                format!("a page is {uncompressed} bytes uncompressed, at most {} are read", limits.max_page_bytes);
            return Err(FormatError::TooLarge { code: "body_too_large", detail });
        }
        let compressed = u32::try_from(page.compressed).map_err(|_| malformed())?;
        at += header.read + u64::from(compressed);
        file.seek_relative(compressed.into()).map_err(FormatError::Io)?;
    }
    Ok(())
}

fn malformed() -> FormatError {
    FormatError::malformed(None, &"a page's header cannot be read")
}

struct Sizes {
    uncompressed: i64,
    compressed: i64,
}

/// A page's header in Thrift's compact protocol, of which only the fields 2 and 3 are of interest.
struct Header<R> {
    bytes: R,
    read: u64,
}

impl<R: Read> Header<R> {
    fn sizes(&mut self) -> Result<Sizes, FormatError> {
        let mut sizes = Sizes { uncompressed: -1, compressed: -1 };
        let mut field = 0_i64;
        loop {
            let byte = self.byte()?;
            let kind = byte & 0x0f;
            if kind == 0 {
                return Ok(sizes);
            }
            field = match byte >> 4 {
                0 => self.zigzag()?,
                further => field + i64::from(further),
            };
            match (field, kind) {
                (2, 5) => sizes.uncompressed = self.zigzag()?,
                (3, 5) => sizes.compressed = self.zigzag()?,
                _ => self.skip(kind, DEPTH)?,
            }
        }
    }

    /// Passes over a value of a kind that is not wanted.
    fn skip(&mut self, kind: u8, depth: u32) -> Result<(), FormatError> {
        let depth = depth.checked_sub(1).ok_or_else(malformed)?;
        match kind {
            // True and false are kinds of their own.
            1 | 2 => Ok(()),
            3 => self.byte().map(drop),
            4..=6 => self.varint().map(drop),
            7 => self.pass(8),
            8 => {
                let length = self.varint()?;
                self.pass(length)
            }
            9 | 10 => self.skip_list(depth),
            12 => loop {
                let byte = self.byte()?;
                let kind = byte & 0x0f;
                if kind == 0 {
                    return Ok(());
                }
                if byte >> 4 == 0 {
                    self.zigzag()?;
                }
                self.skip(kind, depth)?;
            },
            _ => Err(malformed()),
        }
    }

    fn skip_list(&mut self, depth: u32) -> Result<(), FormatError> {
        let byte = self.byte()?;
        let count = match byte >> 4 {
            15 => self.varint()?,
            few => few.into(),
        };
        for _ in 0..count {
            match byte & 0x0f {
                // Within a list, a truth is a byte.
                1 | 2 => self.pass(1)?,
                kind => self.skip(kind, depth)?,
            }
        }
        Ok(())
    }

    fn pass(&mut self, length: u64) -> Result<(), FormatError> {
        let passed = io::copy(&mut (&mut self.bytes).take(length), &mut io::sink()).map_err(FormatError::Io)?;
        self.read += passed;
        if passed == length { Ok(()) } else { Err(malformed()) }
    }

    fn zigzag(&mut self) -> Result<i64, FormatError> {
        let value = self.varint()?;
        Ok((value >> 1).cast_signed() ^ -(value & 1).cast_signed())
    }

    fn varint(&mut self) -> Result<u64, FormatError> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(malformed())
    }

    fn byte(&mut self) -> Result<u8, FormatError> {
        let mut byte = [0];
        self.bytes.read_exact(&mut byte).map_err(|_| malformed())?;
        self.read += 1;
        Ok(byte[0])
    }
}
