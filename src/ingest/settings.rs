//! Settings of uploads.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::sources::SourceSettings;
use crate::car_following::{CheckSettings, CheckSettingsError, ExtractionSettings, ExtractionSettingsError};
use crate::formats::{FormatLimits, FormatLimitsError};

/// Rejections that the interface lets an answer list.
const MAX_LISTED: u32 = 1000;

/// How much is taken, and what is believed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IngestSettings {
    /// Where bodies are spooled; the system's temporary folder when empty. It should be on a disk, not in memory.
    pub spool_folder: PathBuf,
    /// Largest body as it is sent, bytes.
    pub max_body_bytes: u64,
    /// Decoded events of an upload kept in memory before it takes the database's one writer, bytes. An upload within
    /// this holds the writer for the time of writing only, not of decoding.
    pub buffer_bytes: u64,
    /// Rejections listed in the answer; all are kept.
    pub max_listed_rejections: u32,
    /// Of decoding.
    pub limits: FormatLimits,
    /// Of an event's physics.
    pub checks: CheckSettings,
    /// Of events out of recordings of a whole road.
    pub extraction: ExtractionSettings,
    /// When a source is held.
    pub sources: SourceSettings,
}

impl Default for IngestSettings {
    fn default() -> Self {
        Self {
            spool_folder: PathBuf::new(),
            max_body_bytes: 2 << 30,
            buffer_bytes: 32 << 20,
            max_listed_rejections: MAX_LISTED,
            limits: FormatLimits::default(),
            checks: CheckSettings::default(),
            extraction: ExtractionSettings::default(),
            sources: SourceSettings::default(),
        }
    }
}

/// Settings that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IngestSettingsError {
    /// Of decoding.
    #[error("limits.{0}")]
    Limits(#[from] FormatLimitsError),
    /// Of the checks.
    #[error("checks.{0}")]
    Checks(#[from] CheckSettingsError),
    /// Of extraction.
    #[error("extraction.{0}")]
    Extraction(#[from] ExtractionSettingsError),
    /// Of holding sources.
    #[error("sources.{0}: {1} is not within {2} to {3}")]
    Sources(&'static str, f64, f64, f64),
    /// A body of no bytes is none.
    #[error("max_body_bytes must be at least 1")]
    Body,
    /// The interface lists no more.
    #[error("max_listed_rejections must be at most {MAX_LISTED}")]
    Listed,
}

impl IngestSettings {
    /// Checks what types cannot.
    ///
    /// # Errors
    /// Names the first setting that cannot be used.
    pub fn checked(self) -> Result<Self, IngestSettingsError> {
        if self.max_body_bytes == 0 {
            return Err(IngestSettingsError::Body);
        }
        if self.max_listed_rejections > MAX_LISTED {
            return Err(IngestSettingsError::Listed);
        }
        if let Some((name, value, range)) =
            self.sources.numbers().into_iter().find(|(_, value, range)| !range.contains(value))
        {
            return Err(IngestSettingsError::Sources(name, value, *range.start(), *range.end()));
        }
        Ok(Self {
            limits: self.limits.checked()?,
            checks: self.checks.checked()?,
            extraction: self.extraction.checked()?,
            ..self
        })
    }
}
