//! An event as it is kept.

use super::Split;
use crate::car_following::Event;

/// An event of a batch, with what its first copy said of it.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredEvent {
    /// The client's id.
    pub event_id: String,
    /// Where it was recorded.
    pub source: Option<String>,
    /// Of which recording it is a part.
    pub run: Option<String>,
    /// Its side.
    pub split: Split,
    /// Its content.
    pub event: Event,
}
