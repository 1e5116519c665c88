//! A reference driver behind a recorded leader.

use super::ReferenceDriver;
use crate::car_following::{Event, FollowerState};

/// A driven event, one value a step; a buffer that can be driven into again.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Driven {
    /// Bumper-to-bumper spacing, m: recorded before the step that simulation starts from, simulated from there on.
    pub spacing_m: Vec<f64>,
    /// Follower speed likewise, m/s; never below 0 where simulated.
    pub speed_mps: Vec<f64>,
    /// The acceleration that led to each simulated step, as it was driven: whoever stops brakes no harder than that takes,
    /// m/s²; 0 before.
    pub accel_mps2: Vec<f64>,
}

impl Driven {
    fn state(&self, t: usize) -> FollowerState {
        FollowerState { spacing_m: self.spacing_m[t], speed_mps: self.speed_mps[t] }
    }

    fn push(&mut self, state: FollowerState, accel_mps2: f64) {
        self.spacing_m.push(state.spacing_m);
        self.speed_mps.push(state.speed_mps);
        self.accel_mps2.push(accel_mps2);
    }
}

impl ReferenceDriver {
    /// Drives `event` closed loop: steps before `from` are recorded, every later one is simulated behind the recorded leader
    /// with the project's integrator.
    ///
    /// # Panics
    /// When `from` is 0 or the event has no step there.
    #[must_use]
    pub fn drive(&self, event: &Event, from: usize) -> Driven {
        let mut driven = Driven::default();
        self.drive_into(event, from, &mut driven);
        driven
    }

    /// [`Self::drive`] into a buffer, whatever it held.
    ///
    /// # Panics
    /// When `from` is 0 or the event has no step there.
    pub fn drive_into(&self, event: &Event, from: usize, driven: &mut Driven) {
        assert!(0 < from && from < event.steps(), "simulation starts from a recorded step within the event");
        for values in [&mut driven.spacing_m, &mut driven.speed_mps, &mut driven.accel_mps2] {
            values.clear();
            values.reserve(event.steps());
        }
        for t in 0..from {
            driven.push(recorded(event, t), 0.0);
        }
        let (dt_s, leader) = (event.dt_s(), event.leader_speed_mps());
        for t in from - 1..event.steps() - 1 {
            let now = driven.state(t);
            let wished = self.wished_accel_mps2(driven, leader, t, dt_s);
            let next = now.advanced(wished, [leader[t].into(), leader[t + 1].into()], dt_s);
            let stopped = next.speed_mps == 0.0;
            driven.push(next, if stopped { wished.max(-now.speed_mps / dt_s) } else { wished });
        }
    }

    /// What the driver wishes at step `t`, m/s².
    fn wished_accel_mps2(&self, driven: &Driven, leader_mps: &[f32], t: usize, dt_s: f64) -> f64 {
        match self {
            Self::Idm(idm) => idm.accel_mps2(driven.spacing_m[t], driven.speed_mps[t], leader_mps[t].into()),
            Self::Gipps(gipps) => {
                // Before the first recorded step there is nothing to see: that step is seen instead.
                let seen = (t + 1).saturating_sub(gipps.reaction_steps(dt_s));
                gipps.accel_mps2(driven.speed_mps[t], driven.state(seen), leader_mps[seen].into(), dt_s)
            }
            Self::Constant => 0.0,
        }
    }
}

fn recorded(event: &Event, t: usize) -> FollowerState {
    FollowerState { spacing_m: event.spacing_m()[t].into(), speed_mps: event.follower_speed_mps()[t].into() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::car_following::{TrafficRegime, TrafficSettings, generate};
    use crate::reference::ReferenceKind;

    const FROM: usize = 10;

    /// A leader who brakes at 8 m/s² to a standstill 4 m ahead of a follower of 15 m/s, and stays.
    fn emergency() -> Event {
        let leader: Vec<f32> = (0..150).map(|t| (15.0 - 0.8 * (t as f32 - 12.0).max(0.0)).max(0.0)).collect();
        Event::new(0.1, vec![4.0; 150], vec![15.0; 150], leader)
    }

    #[test]
    fn what_is_recorded_stays_and_what_follows_obeys_the_integrator() {
        let event = &generate(TrafficRegime::Slow, 3, 1, &TrafficSettings::default())[0].event;
        for kind in ReferenceKind::ALL {
            let driven = kind.published().drive(event, FROM);
            assert_eq!(driven.spacing_m.len(), event.steps());
            for t in 0..FROM {
                assert_eq!(driven.state(t), recorded(event, t));
            }
            for t in FROM - 1..event.steps() - 1 {
                let (now, next) = (driven.state(t), driven.state(t + 1));
                let leader = f64::midpoint(event.leader_speed_mps()[t].into(), event.leader_speed_mps()[t + 1].into());
                assert!((next.speed_mps - now.speed_mps - 0.1 * driven.accel_mps2[t + 1]).abs() < 1e-9);
                let gained = 0.1 * (leader - f64::midpoint(now.speed_mps, next.speed_mps));
                assert!((next.spacing_m - now.spacing_m - gained).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn constant_speed_is_that_of_the_last_recorded_step() {
        let event = &generate(TrafficRegime::Middle, 3, 1, &TrafficSettings::default())[0].event;
        let driven = ReferenceDriver::Constant.drive(event, FROM);
        assert!(driven.speed_mps[FROM..].iter().all(|&v| v == f64::from(event.follower_speed_mps()[FROM - 1])));
    }

    #[test]
    fn gipps_sees_what_was_there_a_reaction_time_before() {
        // With a reaction of 7 steps, the speed at step 20 follows from what was seen at step 13.
        let event = &generate(TrafficRegime::Slow, 4, 1, &TrafficSettings::default())[0].event;
        let ReferenceDriver::Gipps(gipps) = ReferenceKind::Gipps.published() else { panic!("it is Gipps's") };
        let driven = ReferenceDriver::Gipps(gipps).drive(event, FROM);
        let wished = gipps.speed_mps(driven.state(13), event.leader_speed_mps()[13].into(), 7.0 * 0.1);
        let bounded = wished.clamp(driven.speed_mps[19] - 0.75, driven.speed_mps[19] + 0.17);
        assert!((driven.speed_mps[20] - bounded).abs() < 1e-9, "{} {bounded}", driven.speed_mps[20]);
    }

    #[test]
    fn an_emergency_ends_at_standstill_and_is_driven_on_after_a_collision() {
        for kind in [ReferenceKind::Idm, ReferenceKind::Gipps] {
            let driven = kind.published().drive(&emergency(), FROM);
            assert!(driven.accel_mps2.iter().all(|&a| a >= -7.5));
            assert_eq!(driven.speed_mps.last(), Some(&0.0), "{}", kind.as_str());
            assert_eq!(driven.spacing_m.len(), 150);
        }
        assert!(ReferenceDriver::Constant.drive(&emergency(), FROM).spacing_m[149] < 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn nobody_ever_moves_backwards(
            which in 0..2usize, place in proptest::collection::vec(0.0..=1.0f64, 6), seed in 0..20u64,
        ) {
            let kind = ReferenceKind::ALL[which];
            let values: Vec<f64> =
                kind.parameters().iter().zip(&place).map(|(p, x)| p.low + x * (p.high - p.low)).collect();
            let generated = &generate(TrafficRegime::Slow, seed, 1, &TrafficSettings::default())[0].event;
            for event in [generated, &emergency()] {
                let driven = kind.with(&values).drive(event, FROM);
                prop_assert!(driven.speed_mps.iter().all(|&v| v >= 0.0 && v.is_finite()));
                prop_assert!(driven.spacing_m.iter().all(|s| s.is_finite()));
            }
        }
    }
}
