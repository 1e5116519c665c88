//! Drivers out of the literature, to compare a learned one with: what a user would otherwise run.

mod drive;
mod gipps;
mod kind;
mod parameters;

pub use drive::Driven;
pub use gipps::Gipps;
pub use kind::{ReferenceDriver, ReferenceKind};
pub use parameters::Parameter;
