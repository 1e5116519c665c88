//! Car-following in words, signs and units: everything SI, relative speed = leader − follower, spacing bumper to bumper.

mod event;
mod generator;
mod idm;

pub use event::Event;
pub use generator::{GeneratedEvent, TrafficRegime, TrafficSettings, generate};
pub use idm::{FollowerState, Idm};
