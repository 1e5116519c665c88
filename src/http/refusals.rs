//! Log lines about requests that the gate refuses. Anybody can send as many of these as he likes, so only one within a while is
//! a line of its own, which says how many came since the one before it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use axum::http::StatusCode;

/// Which of them are told.
#[derive(Debug)]
pub struct Refusals {
    began: Instant,
    /// Between two lines.
    interval: Duration,
    /// When the next may be told, ns after `began`.
    next_ns: AtomicU64,
    /// Since the last that was.
    untold: AtomicU64,
}

impl Refusals {
    /// One line within `interval`.
    #[must_use]
    pub fn new(interval: Duration) -> Self {
        Self { began: Instant::now(), interval, next_ns: AtomicU64::new(0), untold: AtomicU64::new(0) }
    }

    /// Whether an answer is one of these.
    pub(super) fn is_one(status: StatusCode) -> bool {
        matches!(status, StatusCode::UNAUTHORIZED | StatusCode::TOO_MANY_REQUESTS)
    }

    /// One more: how many were not told before it, where it is to be.
    pub(super) fn note(&self) -> Option<u64> {
        self.note_after(self.began.elapsed())
    }

    fn note_after(&self, elapsed: Duration) -> Option<u64> {
        let ns = |duration: Duration| u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        let (now, next) = (ns(elapsed), self.next_ns.load(Ordering::Relaxed));
        let later = now.saturating_add(ns(self.interval));
        // Of several at once, the one that moves the moment is told.
        let told =
            now >= next && self.next_ns.compare_exchange(next, later, Ordering::Relaxed, Ordering::Relaxed).is_ok();
        if told {
            return Some(self.untold.swap(0, Ordering::Relaxed));
        }
        self.untold.fetch_add(1, Ordering::Relaxed);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_within_a_while_is_told_with_how_many_were_not() {
        let refusals = Refusals::new(Duration::from_secs(1));
        let told: Vec<_> =
            [0, 1, 500, 999, 1000, 1001, 3000].map(|ms| refusals.note_after(Duration::from_millis(ms))).into();
        assert_eq!(told, [Some(0), None, None, None, Some(3), None, Some(1)]);
    }
}
