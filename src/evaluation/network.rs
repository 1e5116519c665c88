//! A network's closed-loop errors on events.

use rayon::ThreadPool;

use super::Errors;
use crate::car_following::Event;
use crate::driver::{Crew, Drive, DriverShape, Loop, Scaling};
use crate::safety::Envelope;

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

/// Drives `events`, each longer than the horizon, closed loop with the buffers of `crew`.
pub fn drive_all(
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

/// Closed-loop errors of what is served, and how much of it is not the network's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServedErrors {
    /// Of the bounded driver.
    pub errors: Errors,
    /// Simulated steps on which the envelope acted.
    pub acted_steps: u64,
}

/// As [`evaluate`], with the network bounded by an envelope: what a server drives.
#[must_use]
pub fn evaluate_served(
    shape: DriverShape,
    scaling: &Scaling,
    weights: &[f32],
    events: &[Event],
    workers: &ThreadPool,
) -> ServedErrors {
    let long_enough: Vec<_> = events.iter().filter(|event| event.steps() > shape.horizon).collect();
    let mut total = ServedErrors::default();
    let part = |drive: &mut Drive<f32>, piece: &[&Event]| {
        drive.bound(Some(Envelope::new(shape.dt_s)));
        drive.forward(weights, scaling, piece, Loop::Closed);
        let acted_steps: u64 = (0..piece.len()).map(|n| u64::from(drive.acted_steps(n))).sum();
        ServedErrors { errors: errors(drive, shape.horizon, piece), acted_steps }
    };
    Crew::new(shape, workers).each(&long_enough, part, |part| {
        total.errors += part.errors;
        total.acted_steps += part.acted_steps;
    });
    total
}

fn errors(drive: &Drive<f32>, horizon: usize, events: &[&Event]) -> Errors {
    let mut sums = Errors::default();
    for (n, event) in events.iter().enumerate() {
        sums.add(event, horizon, |t| (drive.spacing_m(t, n), drive.speed_mps(t, n)));
    }
    sums
}
