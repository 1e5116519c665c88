//! How well a driver drives: closed-loop errors on events; and reference drivers that were given the chance to drive well.

mod calibrate;
mod errors;
mod network;
mod reference;

pub use calibrate::{Calibration, CalibrationSettings, calibrate};
pub use errors::Errors;
pub use network::{ServedErrors, drive_all, drive_events, evaluate, evaluate_served};
pub use reference::evaluate_reference;
