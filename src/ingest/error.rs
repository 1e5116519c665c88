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
    /// More steps than are taken in at once without being stored.
    #[error("the accepted events have more than {max_steps} steps")]
    TooManySteps {
        /// The limit.
        max_steps: u64,
    },
    /// The database failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Decoding ended in a way it never should.
    #[error("decoding panicked")]
    Panicked,
}
