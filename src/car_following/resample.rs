//! An event at another step.

use super::Event;

/// Steps closer than this are the same step, s.
const SAME_STEP_S: f64 = 1e-9;

/// Number of steps of `dt_s` that fit into `steps` of `from_dt_s`, both ends included.
#[must_use]
pub fn resampled_steps(steps: usize, from_dt_s: f64, dt_s: f64) -> usize {
    if steps == 0 || (from_dt_s - dt_s).abs() < SAME_STEP_S {
        return steps;
    }
    // The tolerance forgives rounding: 149 steps of 0.1 s hold 298 of 0.05 s.
    let ratio = (steps - 1) as f64 * from_dt_s / dt_s;
    (ratio + 1e-6).floor() as usize + 1
}

impl Event {
    /// The event at steps of `dt_s`, by linear interpolation from its first step on; itself when it has that step.
    #[must_use]
    pub fn resample(&self, dt_s: f64) -> Self {
        if (self.dt_s() - dt_s).abs() < SAME_STEP_S || self.steps() == 0 {
            return self.clone();
        }
        let steps = resampled_steps(self.steps(), self.dt_s(), dt_s);
        let at = |values: &[f32]| -> Vec<f32> {
            (0..steps).map(|k| interpolate(values, k as f64 * dt_s / self.dt_s())).collect()
        };
        Self::new(dt_s, at(self.spacing_m()), at(self.follower_speed_mps()), at(self.leader_speed_mps()))
    }
}

/// The value at the fractional index `position`, clamped to the last.
fn interpolate(values: &[f32], position: f64) -> f32 {
    let last = values.len() - 1;
    let left = (position.floor() as usize).min(last);
    let right = (left + 1).min(last);
    let share = (position - left as f64).clamp(0.0, 1.0);
    let (left, right) = (f64::from(values[left]), f64::from(values[right]));
    (left + share * (right - left)) as f32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ramp(dt_s: f64, steps: usize) -> Event {
        let values = |slope: f64| (0..steps).map(|k| (5.0 + slope * k as f64 * dt_s) as f32).collect::<Vec<_>>();
        Event::new(dt_s, values(1.0), values(0.5), values(2.0))
    }

    #[test]
    fn the_same_step_changes_nothing() {
        let event = ramp(0.1, 20);
        assert_eq!(event.resample(0.1), event);
    }

    #[test]
    fn halving_the_step_puts_a_mean_between_neighbours() {
        let event = Event::new(0.2, vec![10.0, 12.0, 11.0], vec![1.0, 3.0, 2.0], vec![0.0, 4.0, 8.0]);
        let finer = event.resample(0.1);
        assert_eq!(finer.spacing_m(), [10.0, 11.0, 12.0, 11.5, 11.0]);
        assert_eq!(finer.leader_speed_mps(), [0.0, 2.0, 4.0, 6.0, 8.0]);
    }

    proptest! {
        #[test]
        fn a_ramp_stays_a_ramp_at_any_step(from in 0.02_f64..0.5, to in 0.02_f64..0.5, steps in 2_usize..200) {
            let event = ramp(from, steps);
            let resampled = event.resample(to);
            prop_assert_eq!(resampled.steps(), resampled_steps(steps, from, to));
            let lasts = (resampled.steps() - 1) as f64 * to;
            prop_assert!(lasts <= (steps - 1) as f64 * from + 1e-5);
            for (k, &s) in resampled.spacing_m().iter().enumerate() {
                prop_assert!((f64::from(s) - (5.0 + k as f64 * to)).abs() < 1e-3);
            }
        }
    }
}
