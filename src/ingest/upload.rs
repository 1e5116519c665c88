//! What came in.

use jiff::Timestamp;

use super::UploadOptions;
use super::spool::Spooled;
use crate::formats::{Encoding, Format};
use crate::lineage::ModelSettings;

/// A body and everything said about it.
#[derive(Debug)]
pub struct Upload {
    /// The model's row id.
    pub model_id: i64,
    /// The model's settings.
    pub model: ModelSettings,
    /// Content type.
    pub format: Format,
    /// Content encoding.
    pub encoding: Encoding,
    /// The query.
    pub options: UploadOptions,
    /// The body.
    pub body: Spooled,
    /// When it came.
    pub received_at: Timestamp,
}
