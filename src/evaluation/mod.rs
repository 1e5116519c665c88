//! How well a driver drives: closed-loop errors on events; and reference drivers that were given the chance to drive well.

mod calibrate;
mod errors;
mod network;
mod reference;

pub use calibrate::{Calibration, CalibrationSettings, calibrate};
pub use errors::Errors;
pub use network::{drive_all, evaluate};
pub use reference::evaluate_reference;
