//! Learning one stage: closed loop behind recorded leaders, deterministic, interruptible.

mod adam;
mod checkpoint;
mod input;
mod learned;
mod line;
mod loss;
mod minibatch;
mod observer;
mod order;
mod rate;
mod replay;
mod sanity;
mod stage;
mod start;

pub use adam::{Adam, clip_norm};
pub use checkpoint::{Checkpoint, stage_fingerprint};
pub use input::{LearnSettings, StageInput};
pub use learned::{LearnError, Learned};
pub use line::Line;
pub use loss::{Penalties, loss};
pub use minibatch::minibatch_gradient;
pub use observer::{Interim, Observer, Progress, Unwatched};
pub use rate::RateSchedule;
pub use replay::ReplayedRegime;
pub use stage::learn_stage;
