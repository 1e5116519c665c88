//! How much each weight matters for what was learned: exact, per step, open loop.

use super::{MasOutput, Method};
use crate::car_following::Event;
use crate::driver::{Crew, Loop, Scaling};
use crate::lstm::{Magnitude, Real};

/// Diagonal importance of the weights for the acceleration ŷ on recorded windows, averaged over all M supervised steps:
///
/// - EWC: the exact Fisher information of a Gaussian head with σ = 1 m/s², `F_i = (1/M) Σ (∂ŷ/∂θ_i)²` (Kirkpatrick et al. 2017);
/// - MAS: `Ω_i = (1/M) Σ |∂ŷ/∂θ_i|` (`jacobian`) or `(1/M) Σ |∂ŷ²/∂θ_i|` (`squared_norm`, Aljundi et al. 2018).
///
/// Every step's own gradient counts, so the result does not depend on how the events came in batches; `events` must be in an
/// order of their own (that of their digests) for equal bits. Returns the importance and M.
///
/// Methods that keep no importance get an empty vector.
pub fn importance<T: Real>(
    method: Method,
    mas_output: MasOutput,
    crew: &Crew<'_, T>,
    scaling: &Scaling,
    weights: &[T],
    horizon: usize,
    events: &[&Event],
) -> (Vec<f64>, u64) {
    let (magnitude, squared) = match (method, mas_output) {
        (Method::Ewc, _) => (Magnitude::Square, false),
        (Method::Mas, MasOutput::Jacobian) => (Magnitude::Absolute, false),
        (Method::Mas, MasOutput::SquaredNorm) => (Magnitude::Absolute, true),
        (Method::Naive | Method::Joint, _) => return (Vec::new(), 0),
    };
    let parts = crew.each(events, |drive, piece| {
        let mut sums = vec![T::zero(); weights.len()];
        drive.forward(weights, scaling, piece, Loop::Open);
        drive.backward_open(weights, |accel| if squared { accel + accel } else { T::one() });
        drive.windows().add_magnitudes(magnitude, &mut sums);
        sums
    });
    let samples: usize = events.iter().map(|event| event.steps() - horizon).sum();
    let mut total = vec![0.0; weights.len()];
    for part in parts {
        for (total, part) in total.iter_mut().zip(part) {
            *total += part.wide();
        }
    }
    for total in &mut total {
        *total /= samples.max(1) as f64;
    }
    (total, samples as u64)
}
