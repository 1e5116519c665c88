//! The body's bytes: decompressed, counted.

use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::ops::RangeInclusive;
use std::rc::Rc;

use super::{Encoding, FormatError, FormatLimits};

const BUFFER_BYTES: usize = 64 << 10;
/// Windows of zstd frames that its library knows, as powers of two.
const ZSTD_WINDOW_LOG: RangeInclusive<u32> = 10..=31;

/// The disk failed, not the body.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct SourceFailed(io::Error);

/// A limit on bytes was reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Excess {
    /// Of the body.
    #[error("the body decompresses to more than {0} bytes")]
    Body(u64),
    /// Of one event or row.
    #[error("one event (or one row) is longer than {0} bytes")]
    Event(u64),
}

impl Excess {
    pub(super) fn code(self) -> &'static str {
        match self {
            Self::Body(_) => "body_too_large",
            Self::Event(_) => "event_too_large",
        }
    }
}

/// Bytes that may still be read, of the body and of the event being read.
#[derive(Debug)]
pub(super) struct Budget {
    max_body: u64,
    max_event: u64,
    /// Largest window of a zstd frame, as a power of two.
    zstd_window_log: u32,
    body: Cell<u64>,
    event: Cell<u64>,
}

impl Budget {
    /// The next event begins. Counting is coarse by one read buffer.
    pub(super) fn next_event(&self) {
        self.event.set(self.max_event.saturating_add(BUFFER_BYTES as u64));
    }

    fn spend(&self, bytes: usize) -> Result<(), Excess> {
        let bytes = bytes as u64;
        let body = self.body.get().checked_sub(bytes).ok_or(Excess::Body(self.max_body))?;
        let event = self.event.get().checked_sub(bytes).ok_or(Excess::Event(self.max_event))?;
        self.body.set(body);
        self.event.set(event);
        Ok(())
    }
}

/// The raw body; its errors are told from those of what reads it.
pub(super) struct RawBody(File);

impl Read for RawBody {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer).map_err(|e| match e.kind() {
            io::ErrorKind::Interrupted => e,
            _ => io::Error::other(SourceFailed(e)),
        })
    }
}

struct Counted<R> {
    inner: R,
    budget: Rc<Budget>,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.budget.spend(read).map_err(io::Error::other)?;
        Ok(read)
    }
}

/// The body from its beginning, and its budget.
pub(super) fn open(mut file: File, limits: &FormatLimits) -> Result<(RawBody, Rc<Budget>), FormatError> {
    file.seek(SeekFrom::Start(0)).map_err(FormatError::Io)?;
    let budget = Budget {
        max_body: limits.max_decompressed_bytes,
        max_event: limits.max_event_bytes,
        zstd_window_log: limits
            .max_zstd_window_bytes
            .max(1)
            .ilog2()
            .clamp(*ZSTD_WINDOW_LOG.start(), *ZSTD_WINDOW_LOG.end()),
        body: Cell::new(limits.max_decompressed_bytes),
        event: Cell::new(0),
    };
    budget.next_event();
    Ok((RawBody(file), Rc::new(budget)))
}

/// The body without its encoding, within its budget.
pub(super) fn decompress(
    body: RawBody,
    encoding: Encoding,
    budget: &Rc<Budget>,
) -> Result<Box<dyn BufRead>, FormatError> {
    fn counted(inner: impl Read + 'static, budget: &Rc<Budget>) -> Box<dyn BufRead> {
        let counted = Counted { inner, budget: Rc::clone(budget) };
        Box::new(BufReader::with_capacity(BUFFER_BYTES, counted))
    }
    Ok(match encoding {
        Encoding::Identity => counted(body, budget),
        Encoding::Gzip => {
            counted(flate2::bufread::MultiGzDecoder::new(BufReader::with_capacity(BUFFER_BYTES, body)), budget)
        }
        Encoding::Zstd => {
            let mut decoder = zstd::stream::read::Decoder::new(body)?;
            decoder.window_log_max(budget.zstd_window_log)?;
            counted(decoder, budget)
        }
    })
}

/// The body without its encoding as a file that can be sought in.
pub(super) fn seekable(body: RawBody, encoding: Encoding, budget: &Rc<Budget>) -> Result<File, FormatError> {
    if encoding == Encoding::Identity {
        return Ok(body.0);
    }
    let mut reader = decompress(body, encoding, budget)?;
    let mut file = tempfile::tempfile().map_err(FormatError::Io)?;
    let mut buffer = vec![0; BUFFER_BYTES];
    loop {
        budget.next_event();
        let read = match reader.read(&mut buffer) {
            Ok(0) => return Ok(file),
            Ok(read) => read,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
            Err(e) => return Err(e.into()),
        };
        io::Write::write_all(&mut file, &buffer[..read]).map_err(FormatError::Io)?;
    }
}
