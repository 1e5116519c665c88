//! A reference driver's closed-loop errors on events.

use rayon::ThreadPool;
use rayon::prelude::*;

use super::Errors;
use crate::car_following::Event;
use crate::reference::{Driven, ReferenceDriver};

/// Events driven one after another by one thread. Part of the arithmetic: sums are grouped by it.
const PIECE_EVENTS: usize = 16;

/// Drives every event closed loop from step `horizon` on; events no longer than the horizon are left out.
#[must_use]
pub fn evaluate_reference(driver: &ReferenceDriver, horizon: usize, events: &[Event], workers: &ThreadPool) -> Errors {
    let long_enough: Vec<_> = events.iter().filter(|event| event.steps() > horizon).collect();
    drive_reference(driver, horizon, &long_enough, workers).errors
}

/// Errors, and how far simulated followers were inside their leaders.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct ReferenceErrors {
    pub(super) errors: Errors,
    /// Σ relu(−s), m.
    pub(super) intrusion_m: f64,
}

/// Drives `events`, each longer than the horizon; the same bits for any number of threads.
pub(super) fn drive_reference(
    driver: &ReferenceDriver,
    horizon: usize,
    events: &[&Event],
    workers: &ThreadPool,
) -> ReferenceErrors {
    let pieces: Vec<_> =
        workers.install(|| events.par_chunks(PIECE_EVENTS).map(|piece| piece_errors(driver, horizon, piece)).collect());
    let mut total = ReferenceErrors::default();
    for piece in pieces {
        total.errors += piece.errors;
        total.intrusion_m += piece.intrusion_m;
    }
    total
}

fn piece_errors(driver: &ReferenceDriver, horizon: usize, events: &[&Event]) -> ReferenceErrors {
    let (mut sums, mut driven) = (ReferenceErrors::default(), Driven::default());
    for event in events {
        driver.drive_into(event, horizon, &mut driven);
        sums.errors.add(event, horizon, |t| (driven.spacing_m[t] as f32, driven.speed_mps[t] as f32));
        sums.intrusion_m += driven.spacing_m[horizon..].iter().map(|&s| (-s).max(0.0)).sum::<f64>();
    }
    sums
}
