//! A driver ready to serve: fixed weights, plain inputs.

use super::features::{MAX_INPUTS, Sight};
use super::{DriverShape, Scaling};
use crate::lstm::{Encoder, EncoderBuffers, Real, vectorised};

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

/// What is seen at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// m/s.
    pub follower_speed_mps: f32,
    /// m/s.
    pub leader_speed_mps: f32,
    /// m.
    pub spacing_m: f32,
}

/// Fixed weights, ready to serve.
#[derive(Debug, Clone)]
pub struct Driver {
    pub(super) shape: DriverShape,
    scaling: Scaling,
    /// Of every input.
    mean: [f32; MAX_INPUTS],
    spread: [f32; MAX_INPUTS],
    pub(super) encoder: Encoder,
}

/// What a thread that predicts keeps from call to call, whatever the driver: once it has grown, nothing is allocated.
#[derive(Debug, Default)]
pub struct DriverBuffers {
    inputs: Vec<f32>,
    encoder: EncoderBuffers,
}

impl Window {
    /// What was seen at step `t`.
    ///
    /// # Panics
    /// When it does not hold that step.
    #[must_use]
    pub fn seen(&self, t: usize) -> Seen {
        Seen {
            follower_speed_mps: self.follower_speed_mps[t],
            leader_speed_mps: self.leader_speed_mps[t],
            spacing_m: self.spacing_m[t],
        }
    }
}

impl Driver {
    /// A driver of these weights; `None` when their number does not fit the shape.
    #[must_use]
    pub fn new(shape: DriverShape, scaling: Scaling, weights: Vec<f32>) -> Option<Self> {
        let (mean, spread) = scaling.all();
        Some(Self { shape, scaling, mean, spread, encoder: Encoder::new(shape.layout(), weights)? })
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
        let mut accel_mps2 = vec![0.0; windows.len()];
        self.accelerations_into(windows, &mut DriverBuffers::default(), &mut accel_mps2);
        accel_mps2
    }

    /// [`Self::accelerations`] without allocating, one for each of `windows`.
    ///
    /// # Panics
    /// When a window does not hold `horizon` steps, or there are not as many places as windows.
    pub fn accelerations_into(&self, windows: &[Window], buffers: &mut DriverBuffers, accel_mps2: &mut [f32]) {
        assert_eq!(windows.len(), accel_mps2.len(), "a place for each window");
        let DriverBuffers { inputs, encoder } = buffers;
        for (windows, heads) in windows.chunks(Encoder::TOGETHER).zip(accel_mps2.chunks_mut(Encoder::TOGETHER)) {
            inputs.clear();
            for window in windows {
                self.check(window);
                for t in 0..self.shape.horizon {
                    self.standardise(window.seen(t), window.seen(0), t, inputs);
                }
            }
            self.encoder.head_values(inputs, encoder, heads);
        }
        self.squash(accel_mps2);
    }

    /// Panics when the window does not hold `horizon` steps.
    pub(super) fn check(&self, window: &Window) {
        let steps = [&window.follower_speed_mps, &window.leader_speed_mps, &window.spacing_m];
        assert!(steps.iter().all(|values| values.len() == self.shape.horizon), "a window holds `horizon` steps");
    }

    /// Appends the inputs of a step, for a network that saw `earlier` so many steps ago: when it began to read, or as far back
    /// as accelerations are measured from.
    #[inline]
    pub(super) fn standardise(&self, now: Seen, earlier: Seen, back: usize, inputs: &mut Vec<f32>) {
        let x = self.shape.features.of(&Sight {
            speed: now.follower_speed_mps,
            leader: now.leader_speed_mps,
            spacing: now.spacing_m,
            earlier: (earlier.follower_speed_mps, earlier.leader_speed_mps),
            elapsed_s: back as f32 * self.shape.dt_s,
        });
        inputs.extend((0..self.shape.features.inputs()).map(|k| (x[k] - self.mean[k]) / self.spread[k]));
    }

    /// From the head's values to accelerations, m/s².
    pub(super) fn squash(&self, heads: &mut [f32]) {
        vectorised(
            #[inline(always)]
            || {
                for head in heads {
                    *head = self.shape.accel_limit_mps2 * head.fast_tanh();
                }
            },
        );
    }
}
