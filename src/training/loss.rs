//! What a drive costs, and its derivative by the simulated trajectory.

use crate::car_following::Event;
use crate::driver::{Drive, TrajectoryGradient};
use crate::lstm::Real;

/// Weights of the two penalties.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Penalties {
    /// Of mean relu(−spacing).
    pub collision: f64,
    /// Of mean relu(−speed).
    pub backward: f64,
}

/// `mean (s − s*)² + mean (v − v*)² + collision·mean relu(−s) + backward·mean relu(−v)`, the means running over `steps`
/// simulated steps (of the whole minibatch, of which these events may be a part). Fills `by` with its derivatives and
/// returns this part of the sum.
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
            if s < T::zero() {
                sum -= penalties.collision * s.wide();
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
