//! A named lineage of versions.

use jiff::Timestamp;

use super::{ModelName, ModelSettings};
use crate::consolidation::Method;

/// A model as clients see it.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Row id, never on the wire.
    pub model_id: i64,
    /// Its name in paths.
    pub name: ModelName,
    /// Fixed at creation.
    pub method: Method,
    /// Resolved.
    pub settings: ModelSettings,
    /// The version that serves.
    pub live: Option<i64>,
    /// The version the next task starts from.
    pub head: Option<i64>,
    /// Whether its training is held.
    pub paused: bool,
    /// Grows with every change; the `ETag`.
    pub revision: i64,
    /// When it was created.
    pub created_at: Timestamp,
}
