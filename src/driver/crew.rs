//! Work on many events, cut into the same pieces whatever the number of threads.

use std::sync::Mutex;

use rayon::ThreadPool;
use rayon::prelude::*;

use super::{Drive, DriverShape};
use crate::car_following::Event;
use crate::lstm::Real;

/// Most events driven together: what eight leave behind is still near when the way back reads it. Part of the arithmetic, as the other bounds are: sums are grouped by them.
const PIECE_EVENTS: usize = 8;
/// Fewest, where there are so many: few events are shared out rather than driven by one thread.
const PIECE_EVENTS_LEAST: usize = 4;
/// Most steps driven together, unless one event has more: bounds the memory of a thread.
const PIECE_STEPS: usize = 8 * 300;
/// Results that wait for their turn, for each thread: enough that threads seldom wait for each other.
const WAITING_PER_THREAD: usize = 4;

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

    /// The shape of its drivers.
    #[must_use]
    pub fn shape(&self) -> DriverShape {
        self.shape
    }

    /// Runs `work` on each piece of `events`, which are sorted longest first before they are cut, and gives the results to
    /// `add` in the order of the pieces. Only a few results exist at a time, however many events there are.
    pub fn each<R: Send>(
        &self,
        events: &[&Event],
        work: impl Fn(&mut Drive<T>, &[&Event]) -> R + Sync,
        mut add: impl FnMut(R),
    ) {
        let mut sorted = events.to_vec();
        sorted.sort_by_key(|event| std::cmp::Reverse(event.steps()));
        let together = WAITING_PER_THREAD * self.workers.current_num_threads();
        for pieces in pieces(&sorted).chunks(together) {
            let results: Vec<R> = self.workers.install(|| {
                pieces
                    .par_iter()
                    .map(|piece| {
                        let mut drive = self.take().unwrap_or_else(|| Drive::new(self.shape));
                        let result = work(&mut drive, piece);
                        self.idle.lock().expect("no thread panics while it holds this lock").push(drive);
                        result
                    })
                    .collect()
            });
            results.into_iter().for_each(&mut add);
        }
    }

    fn take(&self) -> Option<Drive<T>> {
        self.idle.lock().expect("no thread panics while it holds this lock").pop()
    }
}

fn pieces<'a, 'e>(sorted: &'a [&'e Event]) -> Vec<&'a [&'e Event]> {
    let mut pieces = Vec::new();
    let mut rest = sorted;
    let events = sorted.len().div_ceil(2).clamp(PIECE_EVENTS_LEAST, PIECE_EVENTS);
    while let Some(longest) = rest.first() {
        let most = (PIECE_STEPS / longest.steps().max(1)).clamp(1, events).min(rest.len());
        let (piece, after) = rest.split_at(most);
        pieces.push(piece);
        rest = after;
    }
    pieces
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    fn event(steps: usize) -> Event {
        Event::new(0.1, vec![1.0; steps], vec![1.0; steps], vec![1.0; steps])
    }

    /// Counts how many of its kind there are.
    struct Counted<'a>(&'a AtomicUsize, usize);

    impl Drop for Counted<'_> {
        fn drop(&mut self) {
            self.0.fetch_sub(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn results_come_in_order_and_few_of_them_wait() {
        let shape = DriverShape { hidden: 1, horizon: 2, accel_limit_mps2: 1.0, ..DriverShape::PAPER };
        let events: Vec<_> = (0..1000).map(|i| event(2000 - i)).collect();
        let borrowed: Vec<_> = events.iter().collect();
        for threads in [1, 3] {
            let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (alive, mut most, mut lengths) = (AtomicUsize::new(0), 0, Vec::new());
            let work = |_: &mut Drive<f32>, piece: &[&Event]| {
                alive.fetch_add(1, Ordering::Relaxed);
                Counted(&alive, piece[0].steps())
            };
            Crew::new(shape, &workers).each(&borrowed, work, |result| {
                most = most.max(alive.load(Ordering::Relaxed));
                lengths.push(result.1);
            });
            assert!(lengths.len() > 200 && lengths.is_sorted_by(|a, b| a > b));
            assert!(most <= WAITING_PER_THREAD * threads, "{most} results waited for {threads} threads");
        }
    }

    #[test]
    fn pieces_are_bounded_in_events_and_steps_and_lose_none() {
        let events: Vec<_> = [9000, 4000, 2400, 2400].into_iter().chain([150; 40]).map(event).collect();
        let borrowed: Vec<_> = events.iter().collect();
        let sizes: Vec<_> = pieces(&borrowed).iter().map(|piece| piece.len()).collect();
        assert_eq!(sizes, [1, 1, 1, 1, 8, 8, 8, 8, 8]);
        let sizes = |count: usize| pieces(&borrowed[4..4 + count]).iter().map(|piece| piece.len()).collect::<Vec<_>>();
        assert_eq!(
            [sizes(8), sizes(10), sizes(5)],
            [vec![4, 4], vec![5, 5], vec![4, 1]],
            "two threads share few events"
        );
    }
}
