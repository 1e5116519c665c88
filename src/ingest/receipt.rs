//! What an upload came to.

use std::collections::BTreeMap;

use serde::{Serialize, Serializer};

use crate::car_following::Extraction;
use crate::lineage::Rejection;
use crate::store::event::NewEvent;

/// What is answered.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Receipt {
    /// Its row id; `b12` on the wire.
    #[serde(serialize_with = "on_the_wire")]
    pub batch_id: i64,
    /// Events stored, or brought back after a retraction.
    pub accepted: u64,
    /// Events whose content the model had already, in this body or another.
    pub duplicates: u64,
    /// Events refused.
    pub rejected_count: u64,
    /// The first of them, one entry an event.
    pub rejected: Vec<Rejection>,
    /// What was accepted.
    pub summary: Summary,
    /// Sources of its events that are held: what they sent waits until they are released.
    pub held_sources: Vec<String>,
}

impl Receipt {
    /// Whether no event of the upload is stored, by it or before it.
    #[must_use]
    pub fn holds_nothing(&self) -> bool {
        self.accepted == 0 && self.duplicates == 0
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes fields by reference")]
fn on_the_wire<S: Serializer>(batch_id: &i64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("b{batch_id}"))
}

/// The accepted events of an upload; duplicates are not in it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Summary {
    /// How many.
    pub events: u64,
    /// Their steps.
    pub steps: u64,
    /// Their duration, s: steps times step.
    pub seconds: f64,
    /// Least and greatest mean follower speed; none without events.
    pub mean_speed_mps: Option<SpeedRange>,
    /// Events a regime.
    pub regimes: BTreeMap<String, u64>,
    /// Events a split.
    pub splits: BTreeMap<&'static str, u64>,
    /// What became of the rows of a recording of a whole road.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extraction: Option<Extraction>,
}

/// From the slowest to the fastest event.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpeedRange {
    /// m/s.
    pub min: f64,
    /// m/s.
    pub max: f64,
}

impl Summary {
    pub(super) fn add(&mut self, accepted: &NewEvent) {
        let event = &accepted.event;
        let speed = event.mean_speed_mps();
        self.events += 1;
        self.steps += event.steps() as u64;
        self.seconds += event.steps() as f64 * event.dt_s();
        self.mean_speed_mps = Some(match self.mean_speed_mps {
            None => SpeedRange { min: speed, max: speed },
            Some(range) => SpeedRange { min: range.min.min(speed), max: range.max.max(speed) },
        });
        *self.regimes.entry(accepted.regime.as_str().to_owned()).or_default() += 1;
        *self.splits.entry(accepted.split.as_str()).or_default() += 1;
    }
}
