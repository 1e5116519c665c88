//! Which scalars importance is taken over, and the gradient of any combination of them.

use super::{Estimator, ImportanceOptions, Kept, MasOutput, Output};
use crate::car_following::Event;
use crate::driver::{Drive, DriverShape, Loop, Scaling, TrajectoryGradient};
use crate::lstm::{Network, Real};

/// A scalar function of one step's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    /// The output itself; of the trajectory two, spacing and speed.
    Itself,
    /// Half its squared distance from the recording.
    Error,
    /// Its squared norm.
    SquaredNorm,
}

/// The scalars `y_k` of an event whose derivatives make up importance: one or two for each simulated step.
///
/// | output | Fisher | jacobian | squared norm |
/// | --- | --- | --- | --- |
/// | open loop | a (empirical: ½ (a − recorded a)²) | a | a² |
/// | closed loop | s and v, each its own | s and v, each its own | s² + v², one |
#[derive(Debug, Clone, Copy)]
pub(super) struct Scalars {
    shape: DriverShape,
    output: Output,
    scalar: Scalar,
}

impl Scalars {
    pub(super) fn new(kept: Kept, options: ImportanceOptions, shape: DriverShape) -> Self {
        let scalar = match (kept, options.mas_output, options.estimator) {
            (Kept::Fisher, _, Estimator::Empirical) => Scalar::Error,
            (Kept::Sensitivity, MasOutput::SquaredNorm, _) => Scalar::SquaredNorm,
            _ => Scalar::Itself,
        };
        Self { shape, output: options.output, scalar }
    }

    /// How many an event has.
    pub(super) fn count(self, event: &Event) -> usize {
        (event.steps() - self.shape.horizon) * self.each_step()
    }

    fn each_step(self) -> usize {
        if self.output == Output::ClosedLoop && self.scalar == Scalar::Itself { 2 } else { 1 }
    }

    /// `∂y/∂a` of the scalar of step `t`, which the acceleration `a` led to; open loop.
    pub(super) fn by_accel<T: Real>(self, event: &Event, t: usize, a: T) -> T {
        match self.scalar {
            Scalar::Itself => T::one(),
            Scalar::SquaredNorm => a + a,
            Scalar::Error => {
                let speed = |t: usize| f64::from(event.follower_speed_mps()[t]);
                a - T::of((speed(t) - speed(t - 1)) / f64::from(self.shape.dt_s))
            }
        }
    }

    /// Writes `Σ_k c_k ∂y_k/∂θ` of one event into `gradient`: one pass forward and one backward.
    pub(super) fn combine<T: Real>(
        self,
        drive: &mut Drive<T>,
        network: &Network<T>,
        scaling: &Scaling,
        event: &Event,
        coefficients: &[f64],
        gradient: &mut [T],
    ) {
        gradient.fill(T::zero());
        let first = self.shape.horizon;
        match self.output {
            Output::OpenLoop => {
                drive.forward(network, scaling, &[event], Loop::Open);
                let seed = |t: usize, _, a: T| T::of(coefficients[t - first]) * self.by_accel(event, t, a);
                drive.backward_open_sum(network, seed, gradient);
            }
            Output::ClosedLoop => {
                drive.forward(network, scaling, &[event], Loop::Closed);
                let mut by = TrajectoryGradient {
                    spacing: vec![T::zero(); event.steps()],
                    speed: vec![T::zero(); event.steps()],
                };
                for (k, of_step) in coefficients.chunks_exact(self.each_step()).enumerate() {
                    let t = first + k;
                    (by.spacing[t], by.speed[t]) = if let [spacing, speed] = *of_step {
                        (T::of(spacing), T::of(speed))
                    } else {
                        let twice = T::of(2.0 * of_step[0]);
                        (twice * drive.spacing_m(t, 0), twice * drive.speed_mps(t, 0))
                    };
                }
                drive.backward(network, scaling, &by, gradient);
            }
        }
    }
}
