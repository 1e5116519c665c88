//! Sequences and simulations against the windows they stand for.

use proptest::prelude::*;

use super::*;
use crate::car_following::{TrafficRegime, TrafficSettings, generate};
use crate::lstm::initial_weights;

/// Every kind of driver, with weights large enough to saturate some accelerations.
fn drivers(hidden: usize, horizon: usize) -> impl Iterator<Item = Driver> {
    let kinds = [Memory::Window, Memory::Carried].into_iter().flat_map(move |memory| {
        let kinds = [Features::Raw, Features::Motion];
        kinds.map(|features| DriverShape { hidden, horizon, memory, features, ..DriverShape::PAPER })
    });
    kinds.map(|shape| {
        let motion = MotionScaling { mean: [0.1, -0.1, 0.02], spread: [0.8, 0.9, 0.15] };
        let (mean, spread) = ([8.0, 8.5, 0.3, 14.0], [3.0, 3.5, 1.2, 5.0]);
        let scaling = Scaling { mean, spread, low: [0.0; 4], high: [40.0; 4], motion: Some(motion) };
        let weights = initial_weights(shape.layout(), 4).into_iter().map(|w| 4.0 * w).collect();
        Driver::new(shape, scaling, weights).expect("the weights fit")
    })
}

/// The last `horizon` steps, in which the first one stands for those that are missing.
fn window(seen: &[Seen], horizon: usize) -> Window {
    let missing = horizon.saturating_sub(seen.len());
    let last = std::iter::repeat_n(&seen[0], missing).chain(&seen[(seen.len() + missing) - horizon..]);
    let cut = |value: fn(&Seen) -> f32| last.clone().map(value).collect();
    Window {
        follower_speed_mps: cut(|seen| seen.follower_speed_mps),
        leader_speed_mps: cut(|seen| seen.leader_speed_mps),
        spacing_m: cut(|seen| seen.spacing_m),
    }
}

/// At every step of `seen`, a sequence and the window it stands for must have the same bits.
fn sequences_answer_what_windows_do(driver: &Driver, seen: &[Seen]) {
    let mut sequence = driver.sequence();
    for t in 0..seen.len() {
        let answer = driver.next_acceleration(&mut sequence, seen[t]);
        let expected = driver.accelerations(&[window(&seen[..=t], driver.shape().horizon)])[0];
        assert_eq!(answer.to_bits(), expected.to_bits(), "step {t} of {:?}: {answer} {expected}", driver.shape());
    }
}

#[test]
fn a_sequence_answers_what_windows_of_generated_events_are_answered() {
    for regime in TrafficRegime::ALL {
        for generated in generate(regime, 3, 2, &TrafficSettings::default()) {
            let event = generated.event;
            let seen = |t: usize| Seen {
                follower_speed_mps: event.follower_speed_mps()[t],
                leader_speed_mps: event.leader_speed_mps()[t],
                spacing_m: event.spacing_m()[t],
            };
            let seen: Vec<_> = (0..event.steps().min(40)).map(seen).collect();
            drivers(19, 10).for_each(|driver| sequences_answer_what_windows_do(&driver, &seen));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn a_sequence_answers_what_windows_of_any_numbers_are_answered(
        horizon in 2_usize..8,
        steps in prop::collection::vec((-1.0_f32..40.0, 0.0_f32..40.0, -5.0_f32..120.0), 1..20),
    ) {
        let seen = |(follower_speed_mps, leader_speed_mps, spacing_m)| Seen { follower_speed_mps, leader_speed_mps, spacing_m };
        let seen: Vec<_> = steps.into_iter().map(seen).collect();
        drivers(5, horizon).for_each(|driver| sequences_answer_what_windows_do(&driver, &seen));
    }
}

#[test]
fn a_simulation_through_windows_has_the_bits_of_each_windows_answer() {
    let first = Seen { follower_speed_mps: 8.0, leader_speed_mps: 9.0, spacing_m: 12.0 };
    let leader: Vec<f32> = (0..60).map(|t| 9.0 + 3.0 * (t as f32 * 0.2).sin()).collect();
    for driver in drivers(21, 6).filter(|driver| driver.shape().memory == Memory::Window) {
        let mut seen = vec![first; 6];
        for (t, seen) in seen.iter_mut().enumerate() {
            seen.follower_speed_mps += (t as f32).cos();
        }
        let drive = driver.simulate(&window(&seen, 6), &leader, None);
        for t in 0..leader.len() {
            let expected = driver.accelerations(&[window(&seen, 6)])[0];
            assert_eq!(drive.accel_mps2[t].to_bits(), expected.to_bits(), "step {t} of {:?}", driver.shape());
            seen.push(Seen {
                follower_speed_mps: drive.follower_speed_mps[t],
                leader_speed_mps: leader[t],
                spacing_m: drive.spacing_m[t],
            });
        }
    }
}

#[test]
#[should_panic(expected = "a sequence of this driver")]
fn a_sequence_belongs_to_drivers_of_its_shape() {
    let [short, long] = [4, 5].map(|horizon| drivers(5, horizon).next().expect("there are some"));
    let seen = Seen { follower_speed_mps: 8.0, leader_speed_mps: 9.0, spacing_m: 12.0 };
    long.next_acceleration(&mut short.sequence(), seen);
}
