//! A network's closed-loop errors on events.

use rayon::ThreadPool;

use super::Errors;
use crate::car_following::Event;
use crate::driver::{Crew, Drive, DriverShape, Loop, Scaling};

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

fn errors(drive: &Drive<f32>, horizon: usize, events: &[&Event]) -> Errors {
    let mut sums = Errors::default();
    for (n, event) in events.iter().enumerate() {
        sums.add(event, horizon, |t| (drive.spacing_m(t, n), drive.speed_mps(t, n)));
    }
    sums
}
