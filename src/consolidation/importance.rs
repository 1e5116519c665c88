//! How much each weight matters for what was learned.

use std::sync::{Mutex, MutexGuard};

use super::seeds::Scalars;
use super::{Estimator, ImportanceOptions, Kept, Output, exact, sampled};
use crate::car_following::Event;
use crate::driver::{Crew, Drive, Memory, OwnGradients, Scaling};
use crate::lstm::{Network, Real};

/// Events between two looks at whether to go on; a multiple of every size of piece.
const LOOKED_AT_TOGETHER: usize = 64;

/// Diagonal importance of the weights, averaged over all M supervised steps. With g the derivative by the weights of one
/// output, which is the acceleration ŷ on a recorded window (open loop), or the simulated spacing or speed (closed loop):
///
/// - Fisher: `F = (1/M) Σ g²`, for a Gaussian head with σ = 1 (Kirkpatrick et al. 2017); empirical: `(1/M) Σ r² g²`, r being
///   ŷ less the recorded acceleration;
/// - sensitivity: `Ω = (1/M) Σ |g|` (`jacobian`), or `(1/M) Σ |∂‖y‖²/∂θ|` (`squared_norm`, Aljundi et al. 2018), y being ŷ or
///   the simulated (spacing, speed).
///
/// Every output's own gradient counts, so the result does not depend on how the events came in batches; `events` must be in
/// an order of their own (that of their digests) for equal bits. Over the open loop, window by window, exact importance costs
/// about an epoch; over the closed loop, or with a carried state, a pass backward for every output: as many epochs as an
/// event has steps, or twice that. Sampled, it costs a drive forward, and a pass backward for each draw.
///
/// Returns the importance and M; none when `go_on`, asked on the way, says no.
pub fn importance<T: Real>(
    kept: Kept,
    options: ImportanceOptions,
    crew: &Crew<'_, T>,
    scaling: &Scaling,
    weights: &[T],
    events: &[&Event],
    go_on: &mut dyn FnMut() -> bool,
) -> Option<(Vec<f64>, u64)> {
    let shape = crew.shape();
    let scalars = Scalars::new(kept, options, shape);
    let network = Network::new(shape.layout(), weights);
    let idle = Mutex::new(Vec::new());
    let piece_sums = |drive: &mut Drive<T>, piece: &[&Event]| match (options.estimator, options.output) {
        (Estimator::Sampled, _) => sampled::sampled(drive, scalars, kept, options.draws, &network, scaling, piece),
        (_, Output::OpenLoop) if shape.memory == Memory::Window => {
            let mut own = lock(&idle).pop().unwrap_or_else(|| OwnGradients::new(shape));
            let sums = exact::open_loop(&mut own, scalars, kept, &network, scaling, piece);
            lock(&idle).push(own);
            sums
        }
        _ => exact::one_by_one(drive, scalars, kept, &network, scaling, piece),
    };
    let mut sorted = events.to_vec();
    sorted.sort_by_key(|event| std::cmp::Reverse(event.steps()));
    let mut total = vec![0.0; weights.len()];
    for together in sorted.chunks(LOOKED_AT_TOGETHER) {
        if !go_on() {
            return None;
        }
        crew.each(together, piece_sums, |sums| {
            for (total, sum) in total.iter_mut().zip(sums) {
                *total += sum.wide();
            }
        });
    }
    let samples: usize = events.iter().map(|event| event.steps() - shape.horizon).sum();
    for total in &mut total {
        *total /= samples.max(1) as f64;
    }
    Some((total, samples as u64))
}

/// Buffers that no thread uses.
fn lock<T>(idle: &Mutex<Vec<OwnGradients<T>>>) -> MutexGuard<'_, Vec<OwnGradients<T>>> {
    idle.lock().expect("no thread panics while it holds this lock")
}

#[cfg(test)]
mod tests {
    use super::super::MasOutput;
    use super::*;
    use crate::car_following::{TrafficRegime, TrafficSettings, generate};
    use crate::driver::DriverShape;
    use crate::lstm::{INPUTS, Layout, Magnitude, initial_weights};

    /// Every piece kept until the end and then added up: what takes memory that grows with the events.
    fn piece_by_piece(scaling: &Scaling, weights: &[f32], events: &[&Event]) -> Vec<f64> {
        let mut sorted = events.to_vec();
        sorted.sort_by_key(|event| std::cmp::Reverse(event.steps()));
        let network = Network::new(SHAPE.layout(), weights);
        let pieces: Vec<_> = sorted
            .chunks(8)
            .map(|piece| {
                let (mut own, mut sums) = (OwnGradients::new(SHAPE), vec![0.0_f32; weights.len()]);
                for event in piece {
                    own.add(&network, scaling, event, Magnitude::Square, |_, _| 1.0);
                }
                own.finish(&mut sums);
                sums
            })
            .collect();
        let samples: usize = events.iter().map(|event| event.steps() - SHAPE.horizon).sum();
        let sum = |i: usize| pieces.iter().fold(0.0, |sum, piece| sum + f64::from(piece[i]));
        (0..weights.len()).map(|i| sum(i) / samples as f64).collect()
    }

    const EXACT: ImportanceOptions = ImportanceOptions {
        estimator: Estimator::Exact,
        output: Output::OpenLoop,
        mas_output: MasOutput::Jacobian,
        draws: 1,
    };
    const SHAPE: DriverShape = DriverShape { hidden: 4, horizon: 5, accel_limit_mps2: 4.0, ..DriverShape::PAPER };

    fn traffic(count: usize) -> Vec<Event> {
        let lengths = TrafficSettings { min_steps: 40, max_steps: 60, ..TrafficSettings::default() };
        generate(TrafficRegime::Slow, 3, count, &lengths).into_iter().map(|generated| generated.event).collect()
    }

    #[test]
    fn adding_up_on_the_way_changes_no_bit() {
        let events = traffic(500);
        let events: Vec<_> = events.iter().collect();
        let scaling = Scaling::estimate(SHAPE, &events);
        let weights = initial_weights(Layout { hidden: 4, inputs: INPUTS }, 1);
        let expected = piece_by_piece(&scaling, &weights, &events);
        for threads in [1, 3] {
            let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let crew = Crew::new(SHAPE, &workers);
            let (ours, _) = importance(Kept::Fisher, EXACT, &crew, &scaling, &weights, &events, &mut || true).unwrap();
            assert!(ours == expected, "{threads} threads");
        }
    }

    #[test]
    fn it_stops_on_the_way_when_asked() {
        let events = traffic(200);
        let events: Vec<_> = events.iter().collect();
        let workers = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let crew = Crew::<f32>::new(SHAPE, &workers);
        let weights = initial_weights(Layout { hidden: 4, inputs: INPUTS }, 1);
        let mut asked = 0;
        let mut until_the_third = || {
            asked += 1;
            asked < 3
        };
        let scaling = Scaling::estimate(SHAPE, &events);
        let stopped = importance(Kept::Fisher, EXACT, &crew, &scaling, &weights, &events, &mut until_the_third);
        assert_eq!((stopped, asked), (None, 3));
    }
}
