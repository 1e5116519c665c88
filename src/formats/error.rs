//! What makes a whole body unusable.

use std::io;

use super::excerpt::excerpt;
use super::source::{Excess, SourceFailed};
use crate::lineage::Place;

/// Why nothing of a body counts.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The body ends before it is complete.
    #[error("the body is truncated: {detail}")]
    Truncated {
        /// What is missing.
        detail: String,
    },
    /// The body is not what its content type and encoding say.
    #[error("the body is malformed: {detail}")]
    Malformed {
        /// Where, when known.
        place: Option<Place>,
        /// What is wrong.
        detail: String,
    },
    /// The body is well formed and does not say what is needed.
    #[error("{detail}")]
    Invalid {
        /// Where, when known.
        place: Option<Place>,
        /// Stable name.
        code: &'static str,
        /// What is wrong.
        detail: String,
    },
    /// The body exceeds a limit.
    #[error("{detail}")]
    TooLarge {
        /// Stable name.
        code: &'static str,
        /// Which limit.
        detail: String,
    },
    /// A content type or encoding that is not read.
    #[error("{detail}")]
    Unsupported {
        /// `unsupported_media_type` or `unsupported_encoding`.
        code: &'static str,
        /// What is read.
        detail: String,
    },
    /// The file that holds the body could not be read.
    #[error("cannot read the spooled body: {0}")]
    Io(io::Error),
    /// The sink wants no more.
    #[error("decoding was stopped")]
    Stopped,
}

impl FormatError {
    /// Stable name.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Truncated { .. } => "truncated_body",
            Self::Malformed { .. } => "malformed_body",
            Self::Invalid { code, .. } | Self::TooLarge { code, .. } | Self::Unsupported { code, .. } => code,
            Self::Io(_) | Self::Stopped => "internal",
        }
    }

    /// Where in the body, when known.
    #[must_use]
    pub fn place(&self) -> Option<&Place> {
        match self {
            Self::Malformed { place, .. } | Self::Invalid { place, .. } => place.as_ref(),
            _ => None,
        }
    }

    pub(super) fn malformed(place: impl Into<Option<Place>>, detail: &impl ToString) -> Self {
        Self::Malformed { place: place.into(), detail: excerpt(detail) }
    }

    pub(super) fn invalid(place: impl Into<Option<Place>>, code: &'static str, detail: String) -> Self {
        Self::Invalid { place: place.into(), code, detail }
    }
}

/// From a reader of `source`: tells a cut body from a broken one, and both from a failing disk.
impl From<io::Error> for FormatError {
    fn from(error: io::Error) -> Self {
        if error.get_ref().is_some_and(<dyn std::error::Error + Send + Sync>::is::<SourceFailed>) {
            return Self::Io(error);
        }
        if let Some(excess) = error.get_ref().and_then(|e| e.downcast_ref::<Excess>()) {
            return Self::TooLarge { code: excess.code(), detail: excess.to_string() };
        }
        if error.kind() == io::ErrorKind::UnexpectedEof {
            return Self::Truncated { detail: error.to_string() };
        }
        Self::malformed(None, &error)
    }
}
