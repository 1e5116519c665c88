//! How much of a road is in memory.

use crate::car_following::ExtractionSettings;
use crate::formats::FormatError;

/// Bytes that a row counts for.
const ROW_BYTES: usize = 56;

/// Counts what is held, in rows.
#[derive(Debug)]
pub(super) struct Room {
    held: u64,
    most: u64,
}

impl Room {
    pub(super) fn new(settings: &ExtractionSettings) -> Self {
        Self { held: 0, most: settings.max_rows.into() }
    }

    /// Takes room for this many rows more.
    pub(super) fn take(&mut self, rows: u64) -> Result<(), FormatError> {
        self.held += rows;
        if self.held <= self.most {
            return Ok(());
        }
        let detail = format!(
            "more than {} rows of the road would have to be held at once (ingest.extraction.max_rows); send its parts by \
             themselves",
            self.most
        );
        Err(FormatError::TooLarge { code: "too_many_rows", detail })
    }

    /// As [`Self::take`], for a text.
    pub(super) fn take_text(&mut self, text: &str) -> Result<(), FormatError> {
        self.take((text.len() / ROW_BYTES) as u64 + 1)
    }

    /// This many rows are no longer held.
    pub(super) fn give(&mut self, rows: u64) {
        self.held -= rows;
    }
}
