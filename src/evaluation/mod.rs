//! How well a driver drives: closed-loop errors on events.

mod errors;
mod network;

pub use errors::Errors;
pub use network::{drive_all, evaluate};
