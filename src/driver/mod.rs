//! The learned driver: scaling, LSTM and acceleration limit together. Accelerations for windows, and closed-loop drives.

mod crew;
mod drive;
mod features;
mod scaling;
mod serve;
mod shape;

#[cfg(test)]
mod tests;

pub use crew::Crew;
pub use drive::{Drive, Loop, TrajectoryGradient};
pub use features::Features;
pub use scaling::{MotionScaling, Scaling};
pub use serve::{Driver, Simulation, Window};
pub use shape::{DriverShape, Memory};
