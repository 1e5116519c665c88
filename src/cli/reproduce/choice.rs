//! How strongly a method consolidates.

use serde_json::Value;

use super::arguments::Strength;

/// The strength of one method, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    pub(super) strength: Strength,
    /// Everything that a search saw; null without one.
    pub(super) search: Value,
}
