//! Surrogate measures of safety: how close a drive came to a collision, and how rough it was.

use serde::Serialize;

use super::Trajectory;
use crate::car_following::Event;

/// How close one drive came, and how rough it was. Over simulated steps, up to the first collision if there is one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Surrogates {
    /// Least time to collision, s: min s / (v − l) where the follower is faster (Hayward, Highway Research Record 384, 1972).
    /// 0 with a collision, none when the follower never is faster.
    pub min_ttc_s: Option<f64>,
    /// Greatest deceleration rate to avoid a crash, m/s²: max (v − l)² / (2 s) where the follower is faster (Cooper and
    /// Ferguson, Traffic Engineering & Control 17, 1976; DRAC in the later literature). 0 when it never is.
    pub max_drac_mps2: f64,
    /// Least spacing, m.
    pub min_spacing_m: f64,
    /// Hardest braking, m/s², ≥ 0.
    pub max_braking_mps2: f64,
    /// Root mean square of the jerk `(a[t+1] − a[t]) / dt`, m/s³.
    pub jerk_rms_mps3: f64,
    /// Greatest absolute jerk, m/s³.
    pub jerk_max_mps3: f64,
}

impl Surrogates {
    /// Of a drive behind the leader of `event`, simulated from step `horizon` ≥ 1 on.
    #[must_use]
    pub fn of(event: &Event, driven: &Trajectory, horizon: usize) -> Self {
        let spacing = |t: usize| f64::from(driven.spacing_m[t]);
        let speed = |t: usize| f64::from(driven.follower_speed_mps[t]);
        let end = (horizon..event.steps()).find(|&t| spacing(t) <= 0.0);
        let last = end.unwrap_or(event.steps());
        let (mut ttc, mut drac, mut least) = (f64::INFINITY, 0.0_f64, f64::INFINITY);
        for t in horizon..last {
            let closing = speed(t) - f64::from(event.leader_speed_mps()[t]);
            if closing > 0.0 {
                ttc = ttc.min(spacing(t) / closing);
                drac = drac.max(closing * closing / (2.0 * spacing(t)));
            }
            least = least.min(spacing(t));
        }
        if let Some(end) = end {
            (ttc, least) = (0.0, spacing(end));
        }
        let accel: Vec<f64> = (horizon..last).map(|t| (speed(t) - speed(t - 1)) / event.dt_s()).collect();
        let jerk: Vec<f64> = accel.windows(2).map(|a| (a[1] - a[0]) / event.dt_s()).collect();
        let square = jerk.iter().map(|j| j * j).sum::<f64>() / jerk.len().max(1) as f64;
        Self {
            min_ttc_s: ttc.is_finite().then_some(ttc),
            max_drac_mps2: drac,
            min_spacing_m: least,
            max_braking_mps2: accel.iter().fold(0.0, |most: f64, &a| most.max(-a)),
            jerk_rms_mps3: square.sqrt(),
            jerk_max_mps3: jerk.iter().fold(0.0, |most: f64, j| most.max(j.abs())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn driven(event: &Event, spacing_m: Vec<f32>, follower_speed_mps: Vec<f32>) -> Surrogates {
        Surrogates::of(event, &Trajectory { spacing_m, follower_speed_mps, acted_steps: 0, held_steps: 0 }, 1)
    }

    #[test]
    fn the_hand_computed_case_agrees() {
        let event = Event::new(0.5, vec![20.0; 4], vec![10.0; 4], vec![8.0, 8.0, 8.0, 11.0]);
        // Closing at 2, then 1 m/s, then opening; accelerations 0, −2, +4 m/s² in turn.
        let measures = driven(&event, vec![20.0, 16.0, 15.0, 15.5], vec![10.0, 10.0, 9.0, 11.0]);
        assert_eq!(measures.min_ttc_s, Some(8.0));
        assert_eq!(measures.max_drac_mps2, 4.0 / 32.0);
        assert_eq!((measures.min_spacing_m, measures.max_braking_mps2), (15.0, 2.0));
        assert_eq!(measures.jerk_max_mps3, 12.0);
        assert!((measures.jerk_rms_mps3 - 80.0_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_collision_is_a_time_of_zero_and_ends_the_measuring() {
        let event = Event::new(0.5, vec![20.0; 4], vec![10.0; 4], vec![8.0; 4]);
        let measures = driven(&event, vec![2.0, 1.0, -0.5, -3.0], vec![10.0, 10.0, 10.0, 0.0]);
        assert_eq!((measures.min_ttc_s, measures.min_spacing_m), (Some(0.0), -0.5));
        assert_eq!((measures.max_drac_mps2, measures.max_braking_mps2), (2.0, 0.0));
    }

    #[test]
    fn who_never_closes_has_no_time_to_collision() {
        let event = Event::new(0.5, vec![20.0; 3], vec![8.0; 3], vec![9.0; 3]);
        let measures = driven(&event, vec![20.0, 20.5, 21.0], vec![8.0; 3]);
        assert_eq!((measures.min_ttc_s, measures.max_drac_mps2), (None, 0.0));
    }
}
