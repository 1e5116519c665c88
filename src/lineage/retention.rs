//! What of a model is kept: the wire's `retention`.

use serde::{Deserialize, Serialize};

/// What a model keeps; everything where nothing is said.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Retention {
    /// Arrays of learned events are kept for so long after they arrived, s.
    pub events_s: Option<u32>,
    /// So many of the newest versions keep weights and anchors.
    pub versions: Option<u32>,
}
