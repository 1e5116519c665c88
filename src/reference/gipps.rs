//! Gipps's model.

use crate::car_following::{FollowerState, HARDEST_BRAKING_MPS2};

/// The model of Gipps (A behavioural car-following model for computer simulation, Transportation Research B 15, 105, 1981).
///
/// A driver who sees speed v, spacing s and leader speed l at time t drives one reaction time τ later at the least of
///
/// `v + 2.5·a·τ·(1 − v/V)·√(0.025 + v/V)`, approaching the desired speed V as measured on drivers, and
/// `−b·τ + √(b²τ² + b·(2·(s − s₀) − v·τ + l²/b̂))`, the greatest speed from which to stop behind a leader who brakes.
///
/// The second follows from stopping distances. The leader, braking with b̂, comes to rest after `l²/(2b̂)`. The follower reacts
/// after τ, drives on for a margin of θ = τ/2, and then brakes with b: `(v + v')·τ/2 + v'·τ/2 + v'²/(2b)` from t on, v' being
/// the speed at t + τ. Asking that this leaves s₀ of `s + l²/(2b̂)`, and solving for v', gives the expression.
/// (In the paper b and b̂ are negative, and the leader's effective length has the length and s₀ in it.)
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gipps {
    /// V, the speed on a free road, m/s, > 0.
    pub desired_speed_mps: f64,
    /// τ, s, > 0; driven as the nearest whole number of steps, at least one.
    pub reaction_s: f64,
    /// s₀, the spacing kept at standstill, m, > 0.
    pub jam_spacing_m: f64,
    /// a, the greatest acceleration, m/s², > 0.
    pub max_accel_mps2: f64,
    /// b, the hardest braking the driver is willing to do, m/s², > 0.
    pub hardest_braking_mps2: f64,
    /// b̂, the braking the driver expects of the leader, m/s², > 0.
    pub leader_braking_mps2: f64,
}

impl Gipps {
    /// The steps of `dt_s` that a reaction takes, at least one.
    #[must_use]
    pub fn reaction_steps(&self, dt_s: f64) -> usize {
        (self.reaction_s / dt_s).round().max(1.0) as usize
    }

    /// The speed one reaction time of `reaction_s` after `seen`, m/s, ≥ 0.
    #[must_use]
    pub fn speed_mps(&self, seen: FollowerState, leader_mps: f64, reaction_s: f64) -> f64 {
        let (v, share) = (seen.speed_mps, seen.speed_mps / self.desired_speed_mps);
        let free = v + 2.5 * self.max_accel_mps2 * reaction_s * (1.0 - share) * (0.025 + share).sqrt();
        let b = self.hardest_braking_mps2;
        let room_m = 2.0 * (seen.spacing_m - self.jam_spacing_m) - v * reaction_s
            + leader_mps * leader_mps / self.leader_braking_mps2;
        let safe = (b * b * reaction_s * reaction_s + b * room_m).max(0.0).sqrt() - b * reaction_s;
        free.min(safe).max(0.0)
    }

    /// The acceleration of one step of `dt_s` by a driver who drives at `speed_mps` now and saw `seen` and `leader_mps`
    /// [`Self::reaction_steps`] before the end of the step, m/s².
    ///
    /// The paper simulates in steps of τ. In steps of `dt` = τ/k its equation holds at each of them, with what was seen a
    /// reaction time before: `v[t+1] = G(s, v, l at t+1−k)`. These are k sequences of speeds woven into each other, and where
    /// they start apart (a recorded driver is no Gipps driver) the speed would jump between them. So a step accelerates by
    /// no more than a (the free term's greatest acceleration is 0.9985·a) and brakes by no more than 7.5 m/s².
    #[must_use]
    pub fn accel_mps2(&self, speed_mps: f64, seen: FollowerState, leader_mps: f64, dt_s: f64) -> f64 {
        let reaction_s = self.reaction_steps(dt_s) as f64 * dt_s;
        let wished = (self.speed_mps(seen, leader_mps, reaction_s) - speed_mps) / dt_s;
        wished.clamp(-HARDEST_BRAKING_MPS2, self.max_accel_mps2)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::reference::ReferenceKind;

    fn published() -> Gipps {
        let [desired_speed_mps, reaction_s, jam_spacing_m, max_accel_mps2, hardest_braking_mps2, leader_braking_mps2] =
            ReferenceKind::Gipps.published().values()[..]
        else {
            panic!("Gipps has six parameters");
        };
        Gipps {
            desired_speed_mps,
            reaction_s,
            jam_spacing_m,
            max_accel_mps2,
            hardest_braking_mps2,
            leader_braking_mps2,
        }
    }

    fn state(spacing_m: f64, speed_mps: f64) -> FollowerState {
        FollowerState { spacing_m, speed_mps }
    }

    #[test]
    fn the_free_term_agrees_with_a_hand_computed_case() {
        // v = 10, V = 20, a = 1.7, τ = 0.6: 10 + 2.5·1.7·0.6·0.5·√0.525 = 10 + 1.275·0.724569 = 10.923825.
        let speed = published().speed_mps(state(1000.0, 10.0), 10.0, 0.6);
        assert!((speed - 10.923_825).abs() < 1e-6, "{speed}");
    }

    #[test]
    fn the_safe_term_agrees_with_a_hand_computed_case() {
        // s = 12, s₀ = 2, v = 15, l = 8, b = 3.4, b̂ = 3.2, τ = 0.6: b·τ = 2.04;
        // room = 2·10 − 15·0.6 + 64/3.2 = 31; −2.04 + √(4.1616 + 3.4·31) = −2.04 + √109.5616 = 8.427167.
        let speed = published().speed_mps(state(12.0, 15.0), 8.0, 0.6);
        assert!((speed - 8.427_167).abs() < 1e-6, "{speed}");
    }

    #[test]
    fn the_safe_speed_stops_behind_a_leader_who_brakes_as_expected() {
        let gipps = published();
        let (seen, leader, reaction_s) = (state(20.0, 14.0), 12.0, 0.7);
        let next = gipps.speed_mps(seen, leader, reaction_s);
        let driven = (seen.speed_mps + next) * reaction_s / 2.0
            + next * reaction_s / 2.0
            + next * next / (2.0 * gipps.hardest_braking_mps2);
        let room = seen.spacing_m + leader * leader / (2.0 * gipps.leader_braking_mps2);
        assert!((room - driven - gipps.jam_spacing_m).abs() < 1e-9, "{room} {driven}");
    }

    #[test]
    fn a_reaction_takes_whole_steps_and_at_least_one() {
        let gipps = published();
        assert_eq!([gipps.reaction_steps(0.1), gipps.reaction_steps(0.04), gipps.reaction_steps(5.0)], [7, 17, 1]);
    }

    proptest! {
        #[test]
        fn acceleration_is_bounded_and_a_stopped_driver_stays_within_reach(
            spacing in -5.0..200.0f64, speed in 0.0..40.0f64, leader in 0.0..40.0f64, now in 0.0..40.0f64,
        ) {
            let accel = published().accel_mps2(now, state(spacing, speed), leader, 0.1);
            prop_assert!((-HARDEST_BRAKING_MPS2..=1.7).contains(&accel));
            prop_assert!(published().speed_mps(state(spacing, speed), leader, 0.7) >= 0.0);
        }
    }
}
