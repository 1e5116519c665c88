//! What keeps a model from forgetting: importance, anchors, the penalty and its step.

mod method;

pub use method::{Accumulation, Estimator, MasOutput, Method, Output, PenaltyStep};
