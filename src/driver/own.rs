//! Gradients of recorded windows on their own.

use super::drive::recorded_sight;
use super::{DriverShape, Features, Memory, Scaling};
use crate::car_following::Event;
use crate::lstm::{Magnitude, Network, Real, Windows};

/// Goes through the recorded windows of events one by one, a few at a time: what exact importance over the open loop takes.
#[derive(Debug)]
pub struct OwnGradients<T> {
    shape: DriverShape,
    windows: Windows<T>,
    inputs: Vec<T>,
    by_heads: Vec<T>,
}

impl<T: Real> OwnGradients<T> {
    /// Empty buffers.
    ///
    /// # Panics
    /// When the network carries one state, and so reads no windows, or reads more of a step than the paper's.
    #[must_use]
    pub fn new(shape: DriverShape) -> Self {
        assert_eq!(shape.memory, Memory::Window, "a carried state has no windows");
        assert_eq!(shape.features, Features::Raw, "what else a window could be told depends on where it starts");
        let windows = Windows::new(shape.layout(), shape.horizon);
        Self { shape, windows, inputs: Vec::new(), by_heads: Vec::new() }
    }

    /// Sums the magnitude of each window's own gradient: that of a scalar whose derivative by the acceleration `a`
    /// that leads to step `t` is `by_accel(t, a)`.
    pub fn add(
        &mut self,
        network: &Network<T>,
        scaling: &Scaling,
        event: &Event,
        magnitude: Magnitude,
        by_accel: impl Fn(usize, T) -> T,
    ) {
        let horizon = self.shape.horizon;
        let limit = T::of(f64::from(self.shape.accel_limit_mps2));
        let (mean, spread) = scaling.all::<T>();
        let windows = event.steps().saturating_sub(horizon);
        for start in (0..windows).step_by(Windows::<T>::AT_ONCE) {
            let count = Windows::<T>::AT_ONCE.min(windows - start);
            self.inputs.clear();
            for step in start..start + count + horizon - 1 {
                let x = self.shape.features.of::<T>(&recorded_sight(event, step));
                self.inputs.extend((0..self.shape.features.inputs()).map(|k| (x[k] - mean[k]) / spread[k]));
            }
            self.by_heads.clear();
            let heads = self.windows.forward(network, &self.inputs);
            self.by_heads.extend(heads.iter().zip(start + horizon..).map(|(y, answered)| {
                let u = y.fast_tanh();
                by_accel(answered, limit * u) * limit * (T::one() - u * u)
            }));
            self.windows.add_magnitudes(network, &self.by_heads, magnitude);
        }
    }

    /// Adds the sums to those of others, and begins anew.
    pub fn finish(&mut self, sums: &mut [T]) {
        self.windows.finish(sums);
    }
}
