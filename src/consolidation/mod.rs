//! What keeps a model from forgetting: importance, anchors, the penalty and its step.

mod importance;
mod memory;
mod method;
mod penalty;
mod strength;

pub use importance::importance;
pub use memory::RegimeMemory;
pub use method::{Accumulation, Estimator, MasOutput, Method, Output, PenaltyStep};
pub use penalty::Penalty;
pub use strength::{default_accumulation, default_strength, lambda};
