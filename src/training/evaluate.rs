//! Closed-loop measures of a network on test events.

use std::ops::AddAssign;

use rayon::ThreadPool;

use crate::car_following::Event;
use crate::driver::{Crew, Drive, DriverShape, Loop, Scaling};

/// Sums over simulated steps; divide only when reporting.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
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

/// Drives every event closed loop with these weights; events no longer than the horizon are left out.
#[must_use]
pub fn evaluate(
    shape: DriverShape,
    scaling: &Scaling,
    weights: &[f32],
    events: &[Event],
    workers: &ThreadPool,
) -> Errors {
    let long_enough: Vec<_> = events.iter().filter(|event| event.steps() > shape.horizon).collect();
    drive_all(&Crew::new(shape, workers), shape.horizon, scaling, weights, &long_enough)
}

/// Drives `events`, each longer than the horizon, closed loop.
pub(super) fn drive_all(
    crew: &Crew<'_, f32>,
    horizon: usize,
    scaling: &Scaling,
    weights: &[f32],
    events: &[&Event],
) -> Errors {
    let mut total = Errors::default();
    let part = |drive: &mut Drive<f32>, piece: &[&Event]| {
        drive.forward(weights, scaling, piece, Loop::Closed);
        errors(drive, horizon, piece)
    };
    crew.each(events, part, |part| total += part);
    total
}

fn errors(drive: &Drive<f32>, horizon: usize, events: &[&Event]) -> Errors {
    let mut sums = Errors::default();
    for (n, event) in events.iter().enumerate() {
        let mut collided = false;
        for t in horizon..event.steps() {
            let s = drive.spacing_m(t, n);
            sums.spacing_sq += (f64::from(s) - f64::from(event.spacing_m()[t])).powi(2);
            sums.speed_sq += (f64::from(drive.speed_mps(t, n)) - f64::from(event.follower_speed_mps()[t])).powi(2);
            collided |= s <= 0.0;
        }
        sums.collisions += u32::from(collided);
        sums.events += 1;
        sums.steps += (event.steps() - horizon) as u64;
    }
    sums
}
