//! What a driver makes of an event, whichever driver it is.

use crate::car_following::{Event, FollowerState};
use crate::reference;

/// A follower driven behind the leader of an event: one value a step, the event's own before step `horizon`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    /// m.
    pub spacing_m: Vec<f32>,
    /// m/s.
    pub follower_speed_mps: Vec<f32>,
    /// Simulated steps on which an envelope acted for the leader's sake; 0 without one.
    pub acted_steps: u64,
    /// Simulated steps on which it kept the follower from driving backwards.
    pub held_steps: u64,
}

impl Trajectory {
    /// Drives from step `horizon` on by a rule that needs the present state alone: `accel(t, spacing, follower, leader)` is
    /// asked for the acceleration from step t to t + 1, in m/s². The follower stops and never backs.
    #[must_use]
    pub fn by_rule(event: &Event, horizon: usize, mut accel: impl FnMut(usize, f64, f64, f64) -> f64) -> Self {
        let mut spacing_m = event.spacing_m()[..horizon].to_vec();
        let mut follower_speed_mps = event.follower_speed_mps()[..horizon].to_vec();
        let mut state = FollowerState {
            spacing_m: spacing_m[horizon - 1].into(),
            speed_mps: follower_speed_mps[horizon - 1].into(),
        };
        for t in horizon - 1..event.steps() - 1 {
            let leader = [t, t + 1].map(|t| f64::from(event.leader_speed_mps()[t]));
            let wished = accel(t, state.spacing_m, state.speed_mps, leader[0]);
            state = state.advanced(wished, leader, event.dt_s());
            spacing_m.push(state.spacing_m as f32);
            follower_speed_mps.push(state.speed_mps as f32);
        }
        Self { spacing_m, follower_speed_mps, acted_steps: 0, held_steps: 0 }
    }

    /// Whether some simulated spacing is not positive.
    #[must_use]
    pub fn collides(&self, horizon: usize) -> bool {
        self.spacing_m[horizon..].iter().any(|&spacing| spacing <= 0.0)
    }
}

impl From<reference::Driven> for Trajectory {
    fn from(driven: reference::Driven) -> Self {
        let narrow = |values: Vec<f64>| values.into_iter().map(|x| x as f32).collect();
        Self {
            spacing_m: narrow(driven.spacing_m),
            follower_speed_mps: narrow(driven.speed_mps),
            acted_steps: 0,
            held_steps: 0,
        }
    }
}
