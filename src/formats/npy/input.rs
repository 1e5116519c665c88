//! A pickle's bytes, in frames that hold as many as they say.

use std::io::{BufRead, Read};

use super::flaw::broken;
use crate::formats::FormatError;

/// Longest line, such as a name in protocol 2, bytes.
const MAX_LINE_BYTES: u64 = 256;
/// Bytes of what begins a frame: an opcode and a length.
const FRAME_BYTES: u64 = 9;

/// The bytes, counted.
pub(super) struct Input<'i> {
    reader: &'i mut dyn BufRead,
    at: u64,
    /// Where the last frame ends.
    frame_end: u64,
}

impl<'i> Input<'i> {
    pub(super) fn new(reader: &'i mut dyn BufRead) -> Self {
        Self { reader, at: 0, frame_end: 0 }
    }

    /// The next bytes.
    pub(super) fn bytes<const N: usize>(&mut self) -> Result<[u8; N], FormatError> {
        self.at += N as u64;
        Ok(super::bytes(self.reader)?)
    }

    /// So many bytes; what a pickle says of lengths takes no memory before they are there.
    pub(super) fn take(&mut self, length: u64) -> Result<Vec<u8>, FormatError> {
        let mut taken = Vec::new();
        let read = (&mut self.reader).take(length).read_to_end(&mut taken)? as u64;
        self.at += read;
        if read < length {
            let detail = format!("the pickle announces {length} bytes, of which {read} are there");
            return Err(FormatError::Truncated { detail });
        }
        Ok(taken)
    }

    /// Text up to the end of a line.
    pub(super) fn line(&mut self) -> Result<String, FormatError> {
        let mut line = Vec::new();
        self.at += (&mut self.reader).take(MAX_LINE_BYTES).read_until(b'\n', &mut line)? as u64;
        match line.pop() {
            Some(b'\n') => String::from_utf8(line).map_err(|_| broken("a name is not UTF-8")),
            _ if (line.len() as u64) < MAX_LINE_BYTES - 1 => {
                Err(FormatError::Truncated { detail: "the pickle ends within a name".to_owned() })
            }
            _ => Err(broken("a name is longer than any that is known")),
        }
    }

    /// A frame of so many bytes begins.
    pub(super) fn begin_frame(&mut self, length: u64) -> Result<(), FormatError> {
        if self.at - FRAME_BYTES < self.frame_end {
            return Err(broken("a frame lies within a frame"));
        }
        self.frame_end = self.at.saturating_add(length);
        Ok(())
    }

    /// Looks whether what began at `start` ends within the frame in which it began.
    pub(super) fn end_within_frame(&self, start: u64) -> Result<(), FormatError> {
        if start < self.frame_end && self.at > self.frame_end {
            return Err(broken("a frame ends within a value"));
        }
        Ok(())
    }

    /// Looks whether the last frame ends here as well.
    pub(super) fn end(&self) -> Result<(), FormatError> {
        if self.at < self.frame_end {
            return Err(broken("its last frame is longer than the pickle"));
        }
        Ok(())
    }

    /// How many bytes were read.
    pub(super) fn at(&self) -> u64 {
        self.at
    }
}
