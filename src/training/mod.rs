//! Learning one stage: closed loop behind recorded leaders, deterministic, interruptible.

mod adam;
mod checkpoint;
mod evaluate;
mod loss;
mod minibatch;
mod order;
mod sanity;
mod stage;

pub use adam::{Adam, clip_norm};
pub use evaluate::{Errors, evaluate};
pub use loss::{Penalties, loss};
pub use minibatch::minibatch_gradient;
pub use stage::{Interim, LearnError, LearnSettings, Learned, Observer, Progress, StageInput, learn_stage};
