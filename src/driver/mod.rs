//! The learned driver: scaling, LSTM and acceleration limit together. Accelerations for windows, and closed-loop drives.

mod scaling;
mod serve;

pub use scaling::Scaling;
pub use serve::{Driver, DriverShape, Simulation, Window};
