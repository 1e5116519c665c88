//! What a drive costs, and its derivative by the simulated trajectory.

use crate::car_following::Event;
use crate::driver::{Drive, TrajectoryGradient};
use crate::lstm::Real;

/// What driving unsafely costs, beside its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Penalties {
    /// Weight of mean relu(min(margin, s*) − s).
    pub collision: f64,
    /// Weight of mean relu(−v).
    pub backward: f64,
    /// The margin, m; 0 leaves the paper's relu(−s).
    pub collision_margin_m: f64,
}

impl Penalties {
    /// How far a simulated spacing intrudes, m: below 0, or, with a margin, below both the margin and the recorded spacing
    /// s*. The bound never exceeds s*, so whoever drives as recorded pays nothing.
    #[must_use]
    pub fn intrusion_m(&self, spacing_m: f64, recorded_m: f64) -> f64 {
        (self.collision_margin_m.min(recorded_m) - spacing_m).max(0.0)
    }
}

/// `mean (s − s*)² + mean (v − v*)² + collision·mean relu(min(margin, s*) − s) + backward·mean relu(−v)`, the means running
/// over `steps` simulated steps (of the whole minibatch, of which these events may be a part). Fills `by` with its
/// derivatives and returns this part of the sum.
pub fn loss<T: Real>(
    drive: &Drive<T>,
    horizon: usize,
    events: &[&Event],
    penalties: Penalties,
    steps: usize,
    by: &mut TrajectoryGradient<T>,
) -> f64 {
    let len = events.first().map_or(0, |e| e.steps()) * events.len();
    for buffer in [&mut by.spacing, &mut by.speed] {
        buffer.clear();
        buffer.resize(len, T::zero());
    }
    let share = 1.0 / steps as f64;
    let mut sum = 0.0;
    for (n, event) in events.iter().enumerate() {
        for t in horizon..event.steps() {
            let at = t * events.len() + n;
            let (s, v) = (drive.spacing_m(t, n), drive.speed_mps(t, n));
            let off_s = s.wide() - f64::from(event.spacing_m()[t]);
            let off_v = v.wide() - f64::from(event.follower_speed_mps()[t]);
            let (mut by_s, mut by_v) = (2.0 * off_s, 2.0 * off_v);
            sum += off_s * off_s + off_v * off_v;
            let intrusion_m = penalties.intrusion_m(s.wide(), event.spacing_m()[t].into());
            if intrusion_m > 0.0 {
                sum += penalties.collision * intrusion_m;
                by_s -= penalties.collision;
            }
            if v < T::zero() {
                sum -= penalties.backward * v.wide();
                by_v -= penalties.backward;
            }
            by.spacing[at] = T::of(by_s * share);
            by.speed[at] = T::of(by_v * share);
        }
    }
    sum * share
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_drives_as_recorded_does_not_intrude() {
        let penalties = Penalties { collision: 1.0, backward: 1.0, collision_margin_m: 4.0 };
        for recorded in [0.5, 3.0, 4.0, 30.0] {
            assert_eq!(penalties.intrusion_m(recorded, recorded), 0.0);
        }
        assert_eq!(penalties.intrusion_m(2.0, 3.0), 1.0);
        assert_eq!(penalties.intrusion_m(3.5, 30.0), 0.5);
        assert_eq!(penalties.intrusion_m(5.0, 30.0), 0.0);
    }

    #[test]
    fn without_a_margin_only_a_collision_intrudes() {
        let penalties = Penalties { collision: 1.0, backward: 1.0, collision_margin_m: 0.0 };
        assert_eq!(penalties.intrusion_m(0.1, 3.0), 0.0);
        assert_eq!(penalties.intrusion_m(-0.5, 3.0), 0.5);
    }
}
