//! Why nothing of an upload was stored.

use super::OptionError;
use crate::formats::FormatError;
use crate::store::StoreError;

/// Why nothing of an upload was stored.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    /// An option cannot be used.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// The body cannot be used.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The database failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Decoding ended in a way it never should.
    #[error("decoding panicked")]
    Panicked,
}
