//! The learned driver: scaling, LSTM and acceleration limit together. Accelerations for windows, and closed-loop drives.

mod crew;
mod drive;
mod scaling;
mod serve;

#[cfg(test)]
mod tests;

pub use crew::Crew;
pub use drive::{Drive, Loop, TrajectoryGradient};
pub use scaling::Scaling;
pub use serve::{Driver, DriverShape, Simulation, Window};
