//! Car-following events out of recordings of a whole road: which rows of a vehicle follow which leader, and for how long.
//!
//! The criteria are those of `FollowNet` (Chen et al., Scientific Data 10:828, 2023): the same leader throughout, a shortest
//! duration, a bounded spacing, no gap in time.

/// What became of the rows.
mod counts;
/// One vehicle's rows into segments.
mod follower;
/// The criteria.
mod settings;
#[cfg(test)]
mod tests;

pub use counts::Extraction;
pub use follower::{Ahead, Extractor, Follower, Segment, Sighting};
pub use settings::{ExtractionSettings, ExtractionSettingsError};
