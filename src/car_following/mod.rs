//! Car-following in words, signs and units: everything SI, relative speed = leader − follower, spacing bumper to bumper.

mod event;

pub use event::Event;
