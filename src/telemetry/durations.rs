//! How long something took: a histogram that is counted without a lock.

use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Upper bounds, s: from a window computed where it arrives to a request of very many that had to wait.
const BOUNDS_S: [f64; 14] = [1e-5, 2.5e-5, 5e-5, 1e-4, 2.5e-4, 5e-4, 1e-3, 2.5e-3, 5e-3, 0.01, 0.025, 0.1, 0.5, 2.5];

/// Counts by bound, and the sum.
#[derive(Debug, Default)]
pub(super) struct Durations {
    /// Of each bound those within it and not within the one before; the last beyond all bounds.
    counts: [AtomicU64; BOUNDS_S.len() + 1],
    sum_ns: AtomicU64,
}

impl Durations {
    pub(super) fn add(&self, took: Duration) {
        let took_s = took.as_secs_f64();
        let at = BOUNDS_S.iter().position(|&bound| took_s <= bound).unwrap_or(BOUNDS_S.len());
        self.counts[at].fetch_add(1, Ordering::Relaxed);
        self.sum_ns.fetch_add(u64::try_from(took.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }

    /// Takes in what the other has counted.
    pub(super) fn absorb(&self, other: &Self) {
        for (own, counted) in self.counts.iter().zip(&other.counts) {
            own.fetch_add(counted.load(Ordering::Relaxed), Ordering::Relaxed);
        }
        self.sum_ns.fetch_add(other.sum_ns.load(Ordering::Relaxed), Ordering::Relaxed);
    }

    /// Writes the lines of the histogram `name` with these labels; none while nothing was counted.
    pub(super) fn render(&self, name: &str, labels: &str, text: &mut String) {
        let counts = self.counts.each_ref().map(|count| count.load(Ordering::Relaxed));
        let count: u64 = counts.iter().sum();
        if count == 0 {
            return;
        }
        let mut within = 0;
        for (bound_s, count) in BOUNDS_S.iter().zip(counts) {
            within += count;
            let _ = writeln!(text, "{name}_bucket{{{labels},le=\"{bound_s}\"}} {within}");
        }
        let sum_s = Duration::from_nanos(self.sum_ns.load(Ordering::Relaxed)).as_secs_f64();
        let _ = writeln!(text, "{name}_bucket{{{labels},le=\"+Inf\"}} {count}");
        let _ = writeln!(text, "{name}_sum{{{labels}}} {sum_s}\n{name}_count{{{labels}}} {count}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bound_counts_what_lies_within_it_and_sums_add_up() {
        let (one, other) = (Durations::default(), Durations::default());
        one.add(Duration::from_micros(10));
        one.add(Duration::from_micros(30));
        other.add(Duration::from_secs(3));
        one.absorb(&other);
        let mut text = String::new();
        one.render("d_seconds", "model=\"m\"", &mut text);
        let value = |line: &str| text.lines().find_map(|l| l.strip_prefix(line)).map(str::to_owned);
        assert_eq!(value("d_seconds_bucket{model=\"m\",le=\"0.00001\"} ").as_deref(), Some("1"));
        assert_eq!(value("d_seconds_bucket{model=\"m\",le=\"0.00005\"} ").as_deref(), Some("2"));
        assert_eq!(value("d_seconds_bucket{model=\"m\",le=\"2.5\"} ").as_deref(), Some("2"));
        assert_eq!(value("d_seconds_bucket{model=\"m\",le=\"+Inf\"} ").as_deref(), Some("3"));
        assert_eq!(value("d_seconds_sum{model=\"m\"} ").as_deref(), Some("3.00004"));
        assert_eq!(value("d_seconds_count{model=\"m\"} ").as_deref(), Some("3"));
        let mut nothing = String::new();
        Durations::default().render("d", "", &mut nothing);
        assert_eq!(nothing, "");
    }
}
