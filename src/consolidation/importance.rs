//! How much each weight matters for what was learned: exact, per step, open loop.

use super::{MasOutput, Method};
use crate::car_following::Event;
use crate::driver::{Crew, Drive, Loop, Scaling};
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
    let mut total = vec![0.0; weights.len()];
    let piece_sums = |drive: &mut Drive<T>, piece: &[&Event]| {
        let mut sums = vec![T::zero(); weights.len()];
        drive.forward(weights, scaling, piece, Loop::Open);
        drive.backward_open(weights, |accel| if squared { accel + accel } else { T::one() });
        drive.windows().add_magnitudes(magnitude, &mut sums);
        sums
    };
    crew.each(events, piece_sums, |sums| {
        for (total, sum) in total.iter_mut().zip(sums) {
            *total += sum.wide();
        }
    });
    let samples: usize = events.iter().map(|event| event.steps() - horizon).sum();
    for total in &mut total {
        *total /= samples.max(1) as f64;
    }
    (total, samples as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::car_following::{TrafficRegime, TrafficSettings, generate};
    use crate::driver::DriverShape;
    use crate::lstm::{Layout, initial_weights};

    /// Every piece kept until the end and then added up: what takes memory that grows with the events.
    fn piece_by_piece(shape: DriverShape, scaling: &Scaling, weights: &[f32], events: &[&Event]) -> Vec<f64> {
        let mut sorted = events.to_vec();
        sorted.sort_by_key(|event| std::cmp::Reverse(event.steps()));
        let pieces: Vec<_> = sorted
            .chunks(16)
            .map(|piece| {
                let mut drive = Drive::new(shape);
                let mut sums = vec![0.0_f32; weights.len()];
                drive.forward(weights, scaling, piece, Loop::Open);
                drive.backward_open(weights, |_| 1.0);
                drive.windows().add_magnitudes(Magnitude::Square, &mut sums);
                sums
            })
            .collect();
        let samples: usize = events.iter().map(|event| event.steps() - shape.horizon).sum();
        let sum = |i: usize| pieces.iter().fold(0.0, |sum, piece| sum + f64::from(piece[i]));
        (0..weights.len()).map(|i| sum(i) / samples as f64).collect()
    }

    #[test]
    fn adding_up_on_the_way_changes_no_bit() {
        let shape = DriverShape { hidden: 4, horizon: 5, dt_s: 0.1, accel_limit_mps2: 4.0 };
        let lengths = TrafficSettings { min_steps: 40, max_steps: 60, ..TrafficSettings::default() };
        let events: Vec<_> =
            generate(TrafficRegime::Slow, 3, 500, &lengths).into_iter().map(|generated| generated.event).collect();
        let events: Vec<_> = events.iter().collect();
        let scaling = Scaling::estimate(&events);
        let weights = initial_weights(Layout { hidden: 4 }, 1);
        let expected = piece_by_piece(shape, &scaling, &weights, &events);
        for threads in [1, 3] {
            let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let crew = Crew::new(shape, &workers);
            let (ours, _) =
                importance(Method::Ewc, MasOutput::Jacobian, &crew, &scaling, &weights, shape.horizon, &events);
            assert!(ours == expected, "{threads} threads");
        }
    }
}
