//! Most bytes, steps and events.

use serde::{Deserialize, Serialize};

/// Limits of decoding.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FormatLimits {
    /// Most bytes a body may decompress to.
    pub max_decompressed_bytes: u64,
    /// Most bytes of one event (of one row in tabular bodies), as text.
    pub max_event_bytes: u64,
    /// Most bytes a page of a Parquet file may decompress to: one of each column is in memory.
    pub max_page_bytes: u64,
    /// Largest window of a zstd frame, bytes: what a frame may make the decoder hold in memory.
    pub max_zstd_window_bytes: u64,
    /// Most steps of one event.
    pub max_steps: u32,
    /// Most events of one body, rejected ones included.
    pub max_events: u32,
    /// Longest `event_id`, `source` and `run`, bytes.
    pub max_text_bytes: u32,
}

impl Default for FormatLimits {
    fn default() -> Self {
        Self {
            max_decompressed_bytes: 8 << 30,
            max_event_bytes: 16 << 20,
            max_page_bytes: 64 << 20,
            max_zstd_window_bytes: 32 << 20,
            max_steps: 6000,
            max_events: 500_000,
            max_text_bytes: 512,
        }
    }
}

/// A limit that allows nothing.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0} must be at least 1")]
pub struct FormatLimitsError(&'static str);

impl FormatLimits {
    /// Checks that every limit allows something.
    ///
    /// # Errors
    /// Names the first that does not.
    pub fn checked(self) -> Result<Self, FormatLimitsError> {
        for (name, value) in [
            ("max_decompressed_bytes", self.max_decompressed_bytes),
            ("max_event_bytes", self.max_event_bytes),
            ("max_page_bytes", self.max_page_bytes),
            ("max_zstd_window_bytes", self.max_zstd_window_bytes),
            ("max_steps", self.max_steps.into()),
            ("max_events", self.max_events.into()),
            ("max_text_bytes", self.max_text_bytes.into()),
        ] {
            if value == 0 {
                return Err(FormatLimitsError(name));
            }
        }
        Ok(self)
    }
}
