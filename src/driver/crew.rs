//! Work on many events, cut into the same pieces whatever the number of threads.

use std::sync::Mutex;

use rayon::ThreadPool;
use rayon::prelude::*;

use super::{Drive, DriverShape};
use crate::car_following::Event;
use crate::lstm::Real;

/// Most events driven together. Part of the arithmetic: sums are grouped by it.
const PIECE_EVENTS: usize = 16;
/// Most steps driven together, unless one event has more: bounds the memory of a thread.
const PIECE_STEPS: usize = 16 * 300;

/// Threads and the buffers they reuse.
pub struct Crew<'a, T> {
    shape: DriverShape,
    workers: &'a ThreadPool,
    idle: Mutex<Vec<Drive<T>>>,
}

impl<'a, T: Real> Crew<'a, T> {
    /// A crew without buffers yet.
    #[must_use]
    pub fn new(shape: DriverShape, workers: &'a ThreadPool) -> Self {
        Self { shape, workers, idle: Mutex::new(Vec::new()) }
    }

    /// Runs `work` on each piece of `events`, which are sorted longest first before they are cut. Results in the order of the
    /// pieces.
    pub fn each<R: Send>(&self, events: &[&Event], work: impl Fn(&mut Drive<T>, &[&Event]) -> R + Sync) -> Vec<R> {
        let mut sorted = events.to_vec();
        sorted.sort_by_key(|event| std::cmp::Reverse(event.steps()));
        self.workers.install(|| {
            pieces(&sorted)
                .into_par_iter()
                .map(|piece| {
                    let mut drive = self.take().unwrap_or_else(|| Drive::new(self.shape));
                    let result = work(&mut drive, piece);
                    self.idle.lock().expect("no thread panics while it holds this lock").push(drive);
                    result
                })
                .collect()
        })
    }

    fn take(&self) -> Option<Drive<T>> {
        self.idle.lock().expect("no thread panics while it holds this lock").pop()
    }
}

fn pieces<'a, 'e>(sorted: &'a [&'e Event]) -> Vec<&'a [&'e Event]> {
    let mut pieces = Vec::new();
    let mut rest = sorted;
    while let Some(longest) = rest.first() {
        let most = (PIECE_STEPS / longest.steps().max(1)).clamp(1, PIECE_EVENTS).min(rest.len());
        let (piece, after) = rest.split_at(most);
        pieces.push(piece);
        rest = after;
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_bounded_in_events_and_steps_and_lose_none() {
        let event = |steps| Event::new(0.1, vec![1.0; steps], vec![1.0; steps], vec![1.0; steps]);
        let events: Vec<_> = [9000, 4000, 2400, 2400].into_iter().chain([150; 40]).map(event).collect();
        let borrowed: Vec<_> = events.iter().collect();
        let sizes: Vec<_> = pieces(&borrowed).iter().map(|piece| piece.len()).collect();
        assert_eq!(sizes, [1, 1, 2, 16, 16, 8]);
    }
}
