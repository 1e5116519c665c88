//! What became of the rows of a road.

use std::collections::BTreeMap;

use serde::Serialize;

/// Counts of one recording. Every row is a step of an event or in `dropped_steps`; every segment was ended by one of `cut`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Extraction {
    /// Rows: one vehicle at one time.
    pub rows: u64,
    /// Vehicles.
    pub vehicles: u64,
    /// Pairs of a follower and a leader.
    pub pairs: u64,
    /// Stretches of rows in which a vehicle follows the same leader without a break.
    pub segments: u64,
    /// Segments that became events; whether they pass the physics checks is not looked at here.
    pub events: u64,
    /// Segments by what ended them.
    pub cut: BTreeMap<&'static str, u64>,
    /// Stretches of rows that are in no event, by the reason.
    pub dropped: BTreeMap<&'static str, u64>,
    /// Their rows, by the reason.
    pub dropped_steps: BTreeMap<&'static str, u64>,
}

/// Why a row is in no event, or a segment ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Why {
    /// Nobody is ahead.
    NoLeader,
    /// Somebody is, of whom there is no row at that time.
    LeaderMissing,
    /// Closer than the least spacing.
    TooClose,
    /// Farther than the largest spacing.
    TooFar,
    /// Another leader.
    LeaderChanged,
    /// The vehicle has no row at the next step: it left, or the recording has a gap.
    RowMissing,
    /// The longest duration is reached.
    TooLong,
}

impl Why {
    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::NoLeader => "no_leader",
            Self::LeaderMissing => "leader_missing",
            Self::TooClose => "too_close",
            Self::TooFar => "too_far",
            Self::LeaderChanged => "leader_changed",
            Self::RowMissing => "row_missing",
            Self::TooLong => "too_long",
        }
    }
}

impl Extraction {
    /// Rows left out because the recording has them twice.
    pub fn repeated(&mut self, rows: u64) {
        if rows > 0 {
            self.rows += rows;
            self.drop("repeated", rows, rows);
        }
    }

    pub(super) fn drop(&mut self, reason: &'static str, stretches: u64, steps: u64) {
        *self.dropped.entry(reason).or_default() += stretches;
        *self.dropped_steps.entry(reason).or_default() += steps;
    }

    pub(super) fn cut(&mut self, why: Why) {
        *self.cut.entry(why.as_str()).or_default() += 1;
    }
}
