//! What keeps a model from forgetting: importance, anchors, the penalty and its step.

mod accumulation;
mod exact;
mod geometric;
mod importance;
mod memory;
mod method;
mod noise;
mod options;
mod path;
mod penalty;
mod sampled;
mod seeds;
mod strength;

pub use accumulation::Accumulate;
pub use importance::importance;
pub use memory::RegimeMemory;
pub use method::{Kept, Method};
pub use options::{
    Accumulation, Estimator, ImportanceOptions, LEAST_SENSITIVITY_DRAWS, MasOutput, Output, PenaltyStep,
};
pub use path::PathIntegral;
pub use penalty::Penalty;
pub use strength::{default_accumulation, default_strength, lambda, searched_strengths};
