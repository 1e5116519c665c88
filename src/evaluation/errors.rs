//! How far simulated followers are from the recorded ones.

use std::ops::AddAssign;

use serde::{Deserialize, Serialize};

use crate::car_following::Event;
use crate::safety::Trajectory;

/// Sums over simulated steps; divide only when reporting.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Errors {
    /// Σ (s − s*)², m².
    pub spacing_sq: f64,
    /// Σ (v − v*)², m²/s².
    pub speed_sq: f64,
    /// Events with some simulated spacing ≤ 0.
    pub collisions: u32,
    /// Events driven.
    pub events: u32,
    /// Simulated steps.
    pub steps: u64,
}

impl AddAssign for Errors {
    fn add_assign(&mut self, part: Self) {
        self.spacing_sq += part.spacing_sq;
        self.speed_sq += part.speed_sq;
        self.collisions += part.collisions;
        self.events += part.events;
        self.steps += part.steps;
    }
}

impl Errors {
    /// Of one event driven closed loop from step `from` on.
    #[must_use]
    pub fn of(event: &Event, from: usize, driven: &Trajectory) -> Self {
        let mut errors = Self::default();
        errors.add(event, from, |t| (driven.spacing_m[t], driven.follower_speed_mps[t]));
        errors
    }

    /// Mean squared error of the spacing, m²; 0 without steps.
    #[must_use]
    pub fn spacing_mse(&self) -> f64 {
        self.spacing_sq / self.steps.max(1) as f64
    }

    /// Adds one event driven closed loop: `driven(t)` is the simulated spacing (m) and follower speed (m/s) at step `t`, asked
    /// for every step from `from` on.
    pub fn add(&mut self, event: &Event, from: usize, driven: impl Fn(usize) -> (f32, f32)) {
        let mut collided = false;
        for t in from..event.steps() {
            let (spacing, speed) = driven(t);
            self.spacing_sq += (f64::from(spacing) - f64::from(event.spacing_m()[t])).powi(2);
            self.speed_sq += (f64::from(speed) - f64::from(event.follower_speed_mps()[t])).powi(2);
            collided |= spacing <= 0.0;
        }
        self.collisions += u32::from(collided);
        self.events += 1;
        self.steps += (event.steps() - from) as u64;
    }
}
