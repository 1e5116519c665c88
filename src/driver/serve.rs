//! A driver ready to serve: fixed weights, plain inputs.

use super::features::{MAX_INPUTS, Sight};
use super::{DriverShape, Memory, Scaling};
use crate::lstm::{Encoder, Real};
use crate::safety::Envelope;

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
        Some(Self { shape, scaling, encoder: Encoder::new(shape.layout(), weights)? })
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
        let mut inputs = Vec::with_capacity(windows.len() * self.shape.horizon * MAX_INPUTS);
        for window in windows {
            self.check(window);
            for t in 0..self.shape.horizon {
                self.standardise(window, 0, t, &mut inputs);
            }
        }
        self.squash(self.encoder.head_values(self.shape.horizon, &inputs))
    }

    /// Drives on from `initial` behind a leader whose speed is given from the step after the window on: n speeds give n
    /// steps. The first acceleration is what [`Self::accelerations`] answers for the window, within the envelope; later ones
    /// what it answers for the last `horizon` steps, or, with [`Memory::Carried`], what the state carried on from the window
    /// answers. Goes on after a collision.
    ///
    /// # Panics
    /// When the window does not hold `horizon` steps.
    #[must_use]
    pub fn simulate(&self, initial: &Window, leader_speed_mps: &[f32], envelope: Option<Envelope>) -> Simulation {
        self.check(initial);
        let horizon = self.shape.horizon;
        let mut driven = initial.clone();
        let mut accel = Vec::with_capacity(leader_speed_mps.len());
        let mut differing_steps = 0;
        let (mut state, mut encoded) = (self.encoder.state(), 0);
        let mut inputs = Vec::with_capacity(horizon * MAX_INPUTS);
        for &next_leader in leader_speed_mps {
            let now = driven.leader_speed_mps.len() - 1;
            let begin = match self.shape.memory {
                Memory::Window => now + 1 - horizon,
                Memory::Carried => 0,
            };
            if self.shape.memory == Memory::Window {
                (state, encoded) = (self.encoder.state(), begin);
            }
            let mut head = 0.0;
            while encoded <= now {
                inputs.clear();
                self.standardise(&driven, begin, encoded, &mut inputs);
                head = self.encoder.advance(&mut state, &inputs);
                encoded += 1;
            }
            let raw = self.squash(vec![head])[0];
            let (s, v, l) = (driven.spacing_m[now], driven.follower_speed_mps[now], driven.leader_speed_mps[now]);
            let a = envelope.map_or(raw, |e| e.served_mps2(raw, s, v, l));
            differing_steps += usize::from(a != raw);
            let next_v = v + self.shape.dt_s * a;
            let closing = 0.5 * (l + next_leader) - 0.5 * (v + next_v);
            driven.spacing_m.push(s + self.shape.dt_s * closing);
            driven.follower_speed_mps.push(next_v);
            driven.leader_speed_mps.push(next_leader);
            accel.push(a);
        }
        Simulation {
            spacing_m: driven.spacing_m.split_off(horizon),
            follower_speed_mps: driven.follower_speed_mps.split_off(horizon),
            accel_mps2: accel,
            differing_steps,
        }
    }

    fn check(&self, window: &Window) {
        let steps = [&window.follower_speed_mps, &window.leader_speed_mps, &window.spacing_m];
        assert!(steps.iter().all(|values| values.len() == self.shape.horizon), "a window holds `horizon` steps");
    }

    /// The inputs at step `t` of `driven`, for a network that began to read at step `begin`.
    fn standardise(&self, driven: &Window, begin: usize, t: usize, inputs: &mut Vec<f32>) {
        let (follower, leader) = (&driven.follower_speed_mps, &driven.leader_speed_mps);
        let back = (t - begin).min(self.shape.reach());
        let x = self.shape.features.of(&Sight {
            speed: follower[t],
            leader: leader[t],
            spacing: driven.spacing_m[t],
            earlier: (follower[t - back], leader[t - back]),
            elapsed_s: back as f32 * self.shape.dt_s,
        });
        let (mean, spread) = self.scaling.all::<f32>();
        inputs.extend((0..self.shape.features.inputs()).map(|k| (x[k] - mean[k]) / spread[k]));
    }

    fn squash(&self, heads: Vec<f32>) -> Vec<f32> {
        heads.into_iter().map(|y| self.shape.accel_limit_mps2 * y.fast_tanh()).collect()
    }
}
