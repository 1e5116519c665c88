//! The sampled estimators on the carried state against the exact ones, within the statistical error that theory predicts.

use std::f64::consts::PI;

use headway::car_following::Event;
use headway::consolidation::{Estimator, ImportanceOptions, Kept, MasOutput, Output, importance};
use headway::driver::{Crew, DriverShape, Features, Memory, MotionScaling, Scaling};
use headway::lstm::initial_weights;

const SHAPE: DriverShape =
    DriverShape { hidden: 3, horizon: 4, memory: Memory::Carried, features: Features::Motion, ..DriverShape::PAPER };
const SCALING: Scaling = Scaling {
    mean: [8.0, 8.5, 0.3, 14.0],
    spread: [3.0, 3.5, 1.2, 5.0],
    low: [0.0; 4],
    high: [40.0; 4],
    motion: Some(MotionScaling { mean: [0.1, -0.1, 0.02], spread: [0.8, 0.9, 0.15] }),
};
const DRAWS: u32 = 16;
/// Estimates that each stand by themselves.
const ESTIMATES: usize = 400;
/// Standard errors that a figure may be off by: one in a million is further off by chance, and a few hundred are looked at.
const SURE: f64 = 5.0;

/// Two events of different lengths. `number` changes the first spacing, which the state has all but forgotten when the
/// simulation begins: enough for other random numbers, and too little for other derivatives.
fn events(number: usize) -> [Event; 2] {
    [(16, 0.3), (20, 1.1)].map(|(steps, phase): (usize, f32)| {
        let t = |i: usize| i as f32 * 0.1 + phase;
        let mut spacing: Vec<f32> = (0..steps).map(|i| 12.0 + (2.0 * t(i)).sin()).collect();
        spacing[0] *= 1.0 + number as f32 * 1e-6;
        let follower = (0..steps).map(|i| 8.0 + t(i).cos()).collect();
        let leader = (0..steps).map(|i| 8.0 + (1.3 * t(i)).sin()).collect();
        Event::new(0.1, spacing, follower, leader)
    })
}

/// Sums over the scalars of these events, for each weight.
fn sums(kept: Kept, options: ImportanceOptions, events: &[Event]) -> Vec<f64> {
    let workers = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let crew = Crew::<f64>::new(SHAPE, &workers);
    let mut weights: Vec<f64> = initial_weights(SHAPE.layout(), 3).into_iter().map(f64::from).collect();
    for head in &mut weights[SHAPE.layout().head()] {
        *head *= 100.0;
    }
    let events: Vec<&Event> = events.iter().collect();
    let (means, steps) = importance(kept, options, &crew, &SCALING, &weights, &events, &mut || true).unwrap();
    means.into_iter().map(|mean| mean * steps as f64).collect()
}

/// Of an estimate from `DRAWS` draws for one event, in units of what is estimated: variance, and fourth central moment over
/// its square.
fn predicted(kept: Kept) -> (f64, f64) {
    let draws = f64::from(DRAWS);
    match kept {
        // The mean of squares of normals: χ² over its degrees of freedom.
        Kept::Fisher => (2.0 / draws, 3.0 + 12.0 / draws),
        // cosᴰ(π/2D) Π |X|^(1/D) with X Cauchy, of whose absolute value E |X|ˢ = 1 / cos(πs/2).
        Kept::Sensitivity => {
            let raw = |k: f64| (0.5 * PI / draws).cos().powf(k * draws) / (0.5 * PI * k / draws).cos().powf(draws);
            let variance = raw(2.0) - 1.0;
            let fourth = raw(4.0) - 4.0 * raw(3.0) + 6.0 * raw(2.0) - 3.0;
            (variance, fourth / variance.powi(2))
        }
    }
}

#[test]
fn over_a_carried_state_they_are_right_on_average_and_as_noisy_as_theory_says() {
    let fisher = (Kept::Fisher, MasOutput::Jacobian);
    let jacobian = (Kept::Sensitivity, MasOutput::Jacobian);
    let squared_norm = (Kept::Sensitivity, MasOutput::SquaredNorm);
    for (kept, mas_output) in [fisher, jacobian, squared_norm] {
        for output in [Output::OpenLoop, Output::ClosedLoop] {
            let exact = ImportanceOptions { estimator: Estimator::Exact, output, mas_output, draws: DRAWS };
            let sampled = ImportanceOptions { estimator: Estimator::Sampled, ..exact };
            let of_each = events(0).map(|event| sums(kept, exact, &[event]));
            let estimates: Vec<_> = (1..=ESTIMATES).map(|number| sums(kept, sampled, &events(number))).collect();
            let (relative, kurtosis) = predicted(kept);
            for weight in 0..of_each[0].len() {
                let what = format!("{kept:?}, {mas_output:?}, {output:?}, weight {weight}");
                let [one, other] = [&of_each[0], &of_each[1]].map(|sums| sums[weight]);
                let (expected, variance) = (one + other, relative * (one * one + other * other));
                let each = || estimates.iter().map(|estimate| estimate[weight] - expected);
                let mean = |values: f64| values / ESTIMATES as f64;
                let off = mean(each().sum()) / (variance / ESTIMATES as f64).sqrt();
                assert!(off.abs() < SURE, "{what}: the mean is {off:.1} standard errors off {expected}");
                // Of a sum of independent ones the kurtosis is nearer to a normal's: this bound is wide enough.
                let spread = mean(each().map(|off| off * off).sum()) / variance;
                let error = ((kurtosis - 1.0) / ESTIMATES as f64).sqrt();
                assert!((spread - 1.0).abs() < SURE * error, "{what}: {spread:.2} of the predicted variance");
            }
        }
    }
}

/// What an event is estimated at depends on itself, whoever is driven beside it.
#[test]
fn together_they_estimate_what_they_do_one_by_one() {
    let shape = DriverShape { hidden: 19, ..SHAPE };
    let events: Vec<Event> = (0..20).flat_map(events).collect();
    let weights = initial_weights(shape.layout(), 3);
    let workers = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let crew = Crew::<f32>::new(shape, &workers);
    for kept in [Kept::Fisher, Kept::Sensitivity] {
        for output in [Output::OpenLoop, Output::ClosedLoop] {
            let mas_output = MasOutput::Jacobian;
            let options = ImportanceOptions { estimator: Estimator::Sampled, output, mas_output, draws: 3 };
            let of =
                |events: &[&Event]| importance(kept, options, &crew, &SCALING, &weights, events, &mut || true).unwrap();
            let (together, steps) = of(&events.iter().collect::<Vec<_>>());
            let mut apart = vec![0.0; together.len()];
            for event in &events {
                let (means, of_event) = of(&[event]);
                for (sum, mean) in apart.iter_mut().zip(means) {
                    *sum += mean * of_event as f64 / steps as f64;
                }
            }
            let largest = apart.iter().copied().fold(0.0, f64::max);
            for (one, other) in together.iter().zip(&apart) {
                assert!((one - other).abs() < 1e-5 * largest, "{kept:?}, {output:?}: {one} together, {other} apart");
            }
        }
    }
}
