//! Learning one stage: closed loop behind recorded leaders, deterministic, interruptible.

mod evaluate;
mod stage;

pub use evaluate::{Errors, evaluate};
pub use stage::{LearnError, LearnSettings, Learned, Observer, Progress, RegimeMemory, StageInput, learn_stage};
