//! A driver ready to serve: fixed weights, plain inputs.

use super::Scaling;
use crate::lstm::{Encoder, INPUTS, Layout, Real};
use crate::safety::Envelope;

/// What decides how a driver computes, besides its weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriverShape {
    /// Hidden units.
    pub hidden: usize,
    /// Steps in a window.
    pub horizon: usize,
    /// Step, s.
    pub dt_s: f32,
    /// The acceleration lies within ± this, m/s².
    pub accel_limit_mps2: f32,
}

/// The last `horizon` steps, oldest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// m/s.
    pub follower_speed_mps: Vec<f32>,
    /// m/s.
    pub leader_speed_mps: Vec<f32>,
    /// m.
    pub spacing_m: Vec<f32>,
}

/// A simulated follower: one value per given leader step.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Spacing at each leader step, m.
    pub spacing_m: Vec<f32>,
    /// Follower speed at each leader step, m/s.
    pub follower_speed_mps: Vec<f32>,
    /// Acceleration that led to each of them, m/s².
    pub accel_mps2: Vec<f32>,
    /// Steps on which that is not what the network asked for.
    pub differing_steps: usize,
}

/// Fixed weights, ready to serve.
#[derive(Debug, Clone)]
pub struct Driver {
    shape: DriverShape,
    scaling: Scaling,
    encoder: Encoder<f32>,
}

impl Driver {
    /// A driver of these weights; `None` when their number does not fit the shape.
    #[must_use]
    pub fn new(shape: DriverShape, scaling: Scaling, weights: Vec<f32>) -> Option<Self> {
        Some(Self { shape, scaling, encoder: Encoder::new(Layout { hidden: shape.hidden }, weights)? })
    }

    /// Its shape.
    #[must_use]
    pub fn shape(&self) -> DriverShape {
        self.shape
    }

    /// Its scaling.
    #[must_use]
    pub fn scaling(&self) -> &Scaling {
        &self.scaling
    }

    /// Its weights.
    #[must_use]
    pub fn weights(&self) -> &[f32] {
        self.encoder.weights()
    }

    /// The network's acceleration for each window, m/s². Bit-equal for a window whatever the others are.
    ///
    /// # Panics
    /// When a window does not hold `horizon` steps.
    #[must_use]
    pub fn accelerations(&self, windows: &[Window]) -> Vec<f32> {
        let mut inputs = Vec::with_capacity(windows.len() * self.shape.horizon * INPUTS);
        for window in windows {
            let steps = [&window.follower_speed_mps, &window.leader_speed_mps, &window.spacing_m];
            assert!(steps.iter().all(|values| values.len() == self.shape.horizon), "a window holds `horizon` steps");
            for t in 0..self.shape.horizon {
                let (v, l, s) = (window.follower_speed_mps[t], window.leader_speed_mps[t], window.spacing_m[t]);
                self.standardise(v, l, s, &mut inputs);
            }
        }
        self.squash(self.encoder.head_values(self.shape.horizon, &inputs))
    }

    /// Drives on from `initial` behind a leader whose speed is given from the step after the window on: n speeds give n
    /// steps. Each acceleration is what [`Self::accelerations`] answers for the last `horizon` steps, within the envelope.
    /// Goes on after a collision.
    ///
    /// # Panics
    /// When the window does not hold `horizon` steps.
    #[must_use]
    pub fn simulate(&self, initial: &Window, leader_speed_mps: &[f32], envelope: Option<Envelope>) -> Simulation {
        let horizon = self.shape.horizon;
        let mut follower = initial.follower_speed_mps.clone();
        let mut leader = initial.leader_speed_mps.clone();
        let mut spacing = initial.spacing_m.clone();
        let mut accel = Vec::with_capacity(leader_speed_mps.len());
        let mut differing_steps = 0;
        let mut inputs = Vec::with_capacity(horizon * INPUTS);
        assert!([&follower, &leader, &spacing].iter().all(|x| x.len() == horizon), "a window holds `horizon` steps");
        for &next_leader in leader_speed_mps {
            inputs.clear();
            let now = leader.len() - 1;
            for t in now + 1 - horizon..=now {
                self.standardise(follower[t], leader[t], spacing[t], &mut inputs);
            }
            let raw = self.squash(self.encoder.head_values(horizon, &inputs))[0];
            let a = envelope.map_or(raw, |e| e.served_mps2(raw, spacing[now], follower[now], leader[now]));
            differing_steps += usize::from(a != raw);
            let v = follower[now] + self.shape.dt_s * a;
            let closing = 0.5 * (leader[now] + next_leader) - 0.5 * (follower[now] + v);
            spacing.push(spacing[now] + self.shape.dt_s * closing);
            follower.push(v);
            leader.push(next_leader);
            accel.push(a);
        }
        Simulation {
            spacing_m: spacing.split_off(horizon),
            follower_speed_mps: follower.split_off(horizon),
            accel_mps2: accel,
            differing_steps,
        }
    }

    fn standardise(&self, follower: f32, leader: f32, spacing: f32, inputs: &mut Vec<f32>) {
        let x = [follower, leader, leader - follower, spacing];
        inputs.extend((0..INPUTS).map(|k| (x[k] - self.scaling.mean[k]) / self.scaling.spread[k]));
    }

    fn squash(&self, heads: Vec<f32>) -> Vec<f32> {
        heads.into_iter().map(|y| self.shape.accel_limit_mps2 * y.fast_tanh()).collect()
    }
}
