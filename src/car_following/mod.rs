//! Car-following in words, signs and units: everything SI, relative speed = leader − follower, spacing bumper to bumper.

mod check;
mod check_settings;
mod event;
mod extraction;
mod generator;
mod idm;
mod recording;
mod resample;

pub use check_settings::{CheckSettings, CheckSettingsError};
pub use event::Event;
pub use extraction::{
    Ahead, Extraction, ExtractionSettings, ExtractionSettingsError, Extractor, Follower, Segment, Sighting,
};
pub use generator::{GeneratedEvent, TrafficRegime, TrafficSettings, generate};
pub use idm::{FollowerState, HARDEST_BRAKING_MPS2, Idm};
pub use recording::{Conversion, Defect, Recording, SpacingDefinition, Target};
pub use resample::resampled_steps;
