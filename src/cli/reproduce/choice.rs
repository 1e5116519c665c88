//! How strongly each method consolidates.

use serde_json::Value;

use super::arguments::Strength;
use super::search;
use super::work::Work;
use crate::consolidation::Method;

/// The strength of one method, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    pub(super) strength: Strength,
    /// Everything that a search saw; null without one.
    pub(super) search: Value,
}

/// The one place where a strength is chosen: as told, else searched.
pub(super) fn choose(work: &Work<'_>, method: Method) -> anyhow::Result<Choice> {
    if search::is_searched(work, method) {
        return search::search(work, method);
    }
    Ok(Choice { strength: work.options.strength(method), search: Value::Null })
}
