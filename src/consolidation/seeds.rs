//! Which scalars importance is taken over, and the gradient of any combination of them.

use super::{Estimator, ImportanceOptions, Kept, MasOutput, Output};
use crate::car_following::Event;
use crate::driver::{By, Drive, DriverShape, Loop, Scaling, TrajectoryGradient};
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

    /// Drives events, longest first, the way that these scalars are about.
    pub(super) fn drive<T: Real>(
        self,
        drive: &mut Drive<T>,
        network: &Network<T>,
        scaling: &Scaling,
        events: &[&Event],
    ) {
        let which = match self.output {
            Output::OpenLoop => Loop::Open,
            Output::ClosedLoop => Loop::Closed,
        };
        drive.forward(network, scaling, events, which);
    }

    /// After [`Self::drive`], any number of times: gives `each` the number n of every event and `Σ_k c_nk ∂y_nk/∂θ`, the
    /// coefficients being those of the events in their order. One pass backward through all of them.
    pub(super) fn combine<T: Real>(
        self,
        drive: &mut Drive<T>,
        network: &Network<T>,
        scaling: &Scaling,
        events: &[&Event],
        coefficients: &[Vec<f64>],
        each: impl FnMut(usize, &[T]),
    ) {
        let first = self.shape.horizon;
        let mut by = vec![T::zero(); events[0].steps() * events.len()];
        let mut by_speed = if self.output == Output::ClosedLoop { by.clone() } else { Vec::new() };
        for (n, (event, of_event)) in events.iter().zip(coefficients).enumerate() {
            for (t, of_step) in (first..).zip(of_event.chunks_exact(self.each_step())) {
                let at = t * events.len() + n;
                match (self.output, of_step) {
                    (Output::OpenLoop, _) => {
                        by[at] = T::of(of_step[0]) * self.by_accel(event, t, drive.accel_mps2(t, n));
                    }
                    (Output::ClosedLoop, [spacing, speed]) => (by[at], by_speed[at]) = (T::of(*spacing), T::of(*speed)),
                    (Output::ClosedLoop, _) => {
                        let twice = T::of(2.0 * of_step[0]);
                        (by[at], by_speed[at]) = (twice * drive.spacing_m(t, n), twice * drive.speed_mps(t, n));
                    }
                }
            }
        }
        match self.output {
            Output::OpenLoop => drive.backward_each(network, scaling, By::Accelerations(&by), each),
            Output::ClosedLoop => {
                let by = TrajectoryGradient { spacing: by, speed: by_speed };
                drive.backward_each(network, scaling, By::Trajectory(&by), each);
            }
        }
    }
}
