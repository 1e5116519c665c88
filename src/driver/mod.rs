//! The learned driver: scaling, LSTM and acceleration limit together. Accelerations for windows, and closed-loop drives.

mod crew;
mod drive;
mod features;
mod own;
mod scaling;
mod sequence;
mod serve;
mod shape;
mod simulate;

#[cfg(test)]
mod sequence_tests;
#[cfg(test)]
mod tests;

pub use crew::Crew;
pub use drive::{By, Drive, Loop, TrajectoryGradient};
pub use features::Features;
pub use own::OwnGradients;
pub use scaling::{MotionScaling, Scaling};
pub use sequence::Sequence;
pub use serve::{Driver, DriverBuffers, Seen, Window};
pub use shape::{DriverShape, Memory};
pub use simulate::Simulation;
