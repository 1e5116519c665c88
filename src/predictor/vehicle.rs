//! One vehicle that sends its newest step only.

use std::sync::Arc;

use super::loaded::{finite, out_of_range};
use super::{Flag, Loaded, PredictError, Prediction};
use crate::driver::{Seen, Sequence};

/// A vehicle's way through a version: one step in, the answer for its last `horizon` steps out.
#[derive(Debug)]
pub struct Vehicle {
    loaded: Arc<Loaded>,
    sequence: Sequence,
    /// Steps seen, up to `horizon`.
    seen: usize,
    /// Of the last steps, so many more that the answer depends on go on to have one that is out of range.
    out_of_range: usize,
}

impl Vehicle {
    /// A vehicle of which nothing was seen yet; it stays with this version.
    #[must_use]
    pub fn new(loaded: Arc<Loaded>) -> Self {
        Self { sequence: loaded.driver.sequence(), loaded, seen: 0, out_of_range: 0 }
    }

    /// The version that answers.
    #[must_use]
    pub fn version(&self) -> i64 {
        self.loaded.version()
    }

    /// The same vehicle on its way through another version: that one reads the last steps anew.
    #[must_use]
    pub fn moved_to(&self, loaded: Arc<Loaded>) -> Self {
        let mut moved = Self { seen: self.seen.min(loaded.horizon()), ..Self::new(loaded) };
        for step in self.sequence.recent() {
            moved.read(step);
        }
        moved
    }

    /// What [`Loaded::predict`] answers for the last `horizon` steps, of which this is the newest. Until they are in, the
    /// first step stands for the missing ones, and the answer is flagged.
    ///
    /// # Errors
    /// When a value is not finite; then the step was not seen.
    pub fn step(&mut self, now: Seen) -> Result<Prediction, PredictError> {
        let Seen { follower_speed_mps, leader_speed_mps, spacing_m } = now;
        finite(0, "follower_speed_mps", &[follower_speed_mps])?;
        finite(0, "leader_speed_mps", &[leader_speed_mps])?;
        finite(0, "spacing_m", &[spacing_m])?;
        let raw_mps2 = self.read(now);
        let horizon = self.loaded.horizon();
        self.seen = horizon.min(self.seen + 1);
        let warming_up = (self.seen < horizon, Flag::WarmingUp);
        Ok(self.loaded.answer(raw_mps2, now, &[(self.out_of_range > 0, Flag::OutOfRange), warming_up]))
    }

    /// The network's acceleration after this step, m/s².
    fn read(&mut self, now: Seen) -> f32 {
        let driver = &self.loaded.driver;
        let raw_mps2 = driver.next_acceleration(&mut self.sequence, now);
        self.out_of_range = self.out_of_range.saturating_sub(1);
        if out_of_range(driver.scaling(), now) {
            self.out_of_range = self.loaded.horizon();
        }
        raw_mps2
    }
}
