//! The gradient against central differences, serving against driving.

use super::{
    By, Crew, Drive, Driver, DriverShape, Features, Loop, Memory, MotionScaling, OwnGradients, Scaling,
    TrajectoryGradient, Window,
};
use crate::car_following::Event;
use crate::lstm::{INPUTS, Layout, Magnitude, Network, initial_weights};
use crate::safety::Envelope;

const SHAPE: DriverShape = DriverShape { hidden: 5, horizon: 4, accel_limit_mps2: 2.0, ..DriverShape::PAPER };
/// The other network: one state, and features of motion.
const CARRIED: DriverShape = DriverShape { memory: Memory::Carried, features: Features::Motion, ..SHAPE };
const SCALING: Scaling =
    Scaling { mean: [8.0, 8.5, 0.3, 14.0], spread: [3.0, 3.5, 1.2, 5.0], low: [0.0; 4], high: [40.0; 4], motion: None };
const CARRIED_SCALING: Scaling =
    Scaling { motion: Some(MotionScaling { mean: [0.1, -0.1, 0.02], spread: [0.8, 0.9, 0.15] }), ..SCALING };

fn event(steps: usize, phase: f32) -> Event {
    let t = |i: usize| i as f32 * 0.1 + phase;
    Event::new(
        0.1,
        (0..steps).map(|i| 12.0 + (2.0 * t(i)).sin()).collect(),
        (0..steps).map(|i| 8.0 + t(i).cos()).collect(),
        (0..steps).map(|i| 8.0 + (1.3 * t(i)).sin()).collect(),
    )
}

/// Weights large enough to saturate some accelerations.
fn weights() -> Vec<f64> {
    weights_of(SHAPE)
}

fn weights_of(shape: DriverShape) -> Vec<f64> {
    let layout = shape.layout();
    let mut weights: Vec<f64> = initial_weights(layout, 3).into_iter().map(f64::from).collect();
    for w in &mut weights[layout.head()] {
        *w *= 400.0;
    }
    weights
}

/// A smooth scalar of the trajectory with a different derivative at every step.
fn scalar(drive: &Drive<f64>, events: &[&Event]) -> (f64, TrajectoryGradient<f64>) {
    let len = events[0].steps() * events.len();
    let mut by = TrajectoryGradient { spacing: vec![0.0; len], speed: vec![0.0; len] };
    let mut sum = 0.0;
    for (n, event) in events.iter().enumerate() {
        for t in SHAPE.horizon..event.steps() {
            let (s, v) = (drive.spacing_m(t, n), drive.speed_mps(t, n));
            let weight = 1.0 + 0.1 * t as f64 + n as f64;
            sum += weight * (s * s + (0.3 * v).sin());
            by.spacing[t * events.len() + n] = weight * 2.0 * s;
            by.speed[t * events.len() + n] = weight * 0.3 * (0.3 * v).cos();
        }
    }
    (sum, by)
}

#[test]
fn the_closed_loop_gradient_agrees_with_central_differences_for_events_of_different_lengths() {
    agrees_with_central_differences(SHAPE, &SCALING);
}

#[test]
fn so_does_the_gradient_along_a_carried_state_and_through_features_of_motion() {
    agrees_with_central_differences(CARRIED, &CARRIED_SCALING);
    agrees_with_central_differences(DriverShape { features: Features::Raw, ..CARRIED }, &SCALING);
}

#[test]
fn the_open_loop_gradient_along_a_carried_state_agrees_with_central_differences() {
    let (long, short) = (event(14, 0.0), event(9, 0.7));
    let events = [&long, &short];
    let mut drive = Drive::<f64>::new(CARRIED);
    let mut weights = weights_of(CARRIED);
    let weight = |t: usize, n: usize| 1.0 + 0.3 * t as f64 - n as f64;
    drive.forward(&Network::new(CARRIED.layout(), &weights), &CARRIED_SCALING, &events, Loop::Open);
    let mut gradient = vec![0.0; weights.len()];
    let by: Vec<f64> = (0..14).flat_map(|t| (0..2).map(move |n| weight(t, n))).collect();
    drive.backward(&Network::new(CARRIED.layout(), &weights), &CARRIED_SCALING, By::Accelerations(&by), &mut gradient);
    for i in 0..weights.len() {
        let (kept, h) = (weights[i], 1e-5);
        let mut at = |w: f64| {
            weights[i] = w;
            drive.forward(&Network::new(CARRIED.layout(), &weights), &CARRIED_SCALING, &events, Loop::Open);
            let of = |n: usize| (CARRIED.horizon..events[n].steps()).map(move |t| (t, n));
            of(0).chain(of(1)).map(|(t, n)| weight(t, n) * drive.accel_mps2(t, n)).sum::<f64>()
        };
        let central = (at(kept + h) - at(kept - h)) / (2.0 * h);
        weights[i] = kept;
        assert!((central - gradient[i]).abs() <= 1e-5 * (1.0 + central.abs()), "weight {i}");
    }
}

fn agrees_with_central_differences(shape: DriverShape, scaling: &Scaling) {
    let (long, short, shortest) = (event(23, 0.0), event(16, 0.7), event(5, 1.9));
    let events = [&long, &short, &shortest];
    let mut drive = Drive::<f64>::new(shape);
    let mut weights = weights_of(shape);
    drive.forward(&Network::new(shape.layout(), &weights), scaling, &events, Loop::Closed);
    let saturated = (SHAPE.horizon..23).filter(|&t| drive.accel_mps2(t, 0).abs() > 0.95 * 2.0).count();
    assert!(saturated > 0, "the case is meant to be hard");
    let (_, by) = scalar(&drive, &events);
    let mut gradient = vec![0.0; weights.len()];
    drive.backward(&Network::new(shape.layout(), &weights), scaling, By::Trajectory(&by), &mut gradient);
    for i in 0..weights.len() {
        let (kept, h) = (weights[i], 1e-5);
        let mut at = |w: f64| {
            weights[i] = w;
            drive.forward(&Network::new(shape.layout(), &weights), scaling, &events, Loop::Closed);
            scalar(&drive, &events).0
        };
        let central = (at(kept + h) - at(kept - h)) / (2.0 * h);
        weights[i] = kept;
        let off = (central - gradient[i]).abs();
        assert!(
            off <= 1e-5 * (1.0 + central.abs()),
            "weight {i}: {} by the pass, {central} by differences",
            gradient[i]
        );
    }
}

#[test]
fn own_gradients_add_up_to_the_whole_and_are_those_of_events_driven_alone() {
    let (long, short, shortest) = (event(23, 0.0), event(16, 0.7), event(5, 1.9));
    let events = [&long, &short, &shortest];
    let both = [(SHAPE, &SCALING), (CARRIED, &CARRIED_SCALING)];
    for ((shape, scaling), which) in both.into_iter().flat_map(|kind| [(kind, Loop::Open), (kind, Loop::Closed)]) {
        let weights = weights_of(shape);
        let network = Network::new(shape.layout(), &weights);
        let mut drive = Drive::<f64>::new(shape);
        let mut own = |events: &[&Event]| {
            drive.forward(&network, scaling, events, which);
            let (_, by) = scalar(&drive, events);
            let by = if which == Loop::Closed { By::Trajectory(&by) } else { By::Accelerations(&by.speed) };
            let (mut whole, mut first, mut own) = (vec![0.0; weights.len()], Vec::new(), Vec::new());
            drive.backward(&network, scaling, by, &mut whole);
            // A second way back finds what the first one did.
            drive.backward_each(&network, scaling, by, |_, gradient| first.push(gradient.to_vec()));
            drive.backward_each(&network, scaling, by, |_, gradient| own.push(gradient.to_vec()));
            assert_eq!(first, own);
            (whole, own)
        };
        let (whole, each) = own(&events);
        assert_eq!(each.len(), 3);
        for i in 0..weights.len() {
            let sum: f64 = each.iter().map(|gradient| gradient[i]).sum();
            assert!(
                (sum - whole[i]).abs() <= 1e-10 * (1.0 + sum.abs()),
                "{which:?}, weight {i}: {sum} of {}",
                whole[i]
            );
        }
        // The first has the same scalar alone.
        let (alone, of_one) = own(&events[..1]);
        for i in 0..weights.len() {
            assert!((each[0][i] - alone[i]).abs() <= 1e-10 * (1.0 + alone[i].abs()), "{which:?}, weight {i}");
            assert!((of_one[0][i] - alone[i]).abs() <= 1e-10 * (1.0 + alone[i].abs()), "{which:?}, weight {i}");
        }
    }
}

#[test]
fn every_windows_own_gradient_is_squared_before_it_is_summed() {
    let (long, short) = (event(14, 0.0), event(9, 0.7));
    let events = [&long, &short];
    let mut drive = Drive::<f64>::new(SHAPE);
    let mut weights = weights();
    let magnitudes = |magnitude| {
        let (mut own, mut sums) = (OwnGradients::new(SHAPE), vec![0.0; weights.len()]);
        for event in events {
            let by_accel = |_, accel: f64| 2.0 * accel;
            own.add(&Network::new(SHAPE.layout(), &weights), &SCALING, event, magnitude, by_accel);
        }
        own.finish(&mut sums);
        sums
    };
    let (squares, absolutes) = (magnitudes(Magnitude::Square), magnitudes(Magnitude::Absolute));
    let outputs = |weights: &[f64], drive: &mut Drive<f64>| -> Vec<f64> {
        drive.forward(&Network::new(SHAPE.layout(), weights), &SCALING, &events, Loop::Open);
        let of = |n: usize| (SHAPE.horizon..events[n].steps()).map(move |t| (t, n));
        of(0).chain(of(1)).map(|(t, n)| drive.accel_mps2(t, n).powi(2)).collect()
    };
    for i in 0..weights.len() {
        let (kept, h) = (weights[i], 1e-5);
        weights[i] = kept + h;
        let up = outputs(&weights, &mut drive);
        weights[i] = kept - h;
        let down = outputs(&weights, &mut drive);
        weights[i] = kept;
        let each = up.iter().zip(&down).map(|(up, down)| (up - down) / (2.0 * h));
        let (square, absolute) = each.fold((0.0, 0.0), |(s, a), g| (s + g * g, a + g.abs()));
        assert!((square - squares[i]).abs() <= 1e-5 * (1.0 + square), "weight {i}: {} {square}", squares[i]);
        assert!((absolute - absolutes[i]).abs() <= 1e-5 * (1.0 + absolute), "weight {i}: {} {absolute}", absolutes[i]);
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let events: Vec<_> = (0..40).map(|i| event(12 + i % 7, i as f32)).collect();
    let borrowed: Vec<_> = events.iter().collect();
    let weights: Vec<f32> = weights().into_iter().map(|w| w as f32).collect();
    let run = |threads| {
        let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut ends = Vec::new();
        let drive = |drive: &mut Drive<f32>, piece: &[&Event]| {
            drive.forward(&Network::new(SHAPE.layout(), &weights), &SCALING, piece, Loop::Closed);
            (0..piece.len()).map(|n| drive.spacing_m(piece[n].steps() - 1, n)).collect::<Vec<_>>()
        };
        Crew::new(SHAPE, &workers).each(&borrowed, drive, |of_piece| ends.push(of_piece));
        ends
    };
    assert_eq!(run(1), run(3));
}

fn window(event: &Event, from: usize) -> Window {
    let cut = |values: &[f32]| values[from..from + SHAPE.horizon].to_vec();
    Window {
        follower_speed_mps: cut(event.follower_speed_mps()),
        leader_speed_mps: cut(event.leader_speed_mps()),
        spacing_m: cut(event.spacing_m()),
    }
}

#[test]
fn serving_answers_what_driving_computes_with_windows_and_with_a_carried_state() {
    serving_answers_what_driving_computes(SHAPE, SCALING);
    serving_answers_what_driving_computes(CARRIED, CARRIED_SCALING);
}

#[test]
fn the_first_step_of_a_carried_drive_is_what_the_window_is_answered() {
    let event = event(30, 0.4);
    let weights: Vec<f32> = weights_of(CARRIED).into_iter().map(|w| w as f32).collect();
    let driver = Driver::new(CARRIED, CARRIED_SCALING, weights).unwrap();
    for from in [0, 7] {
        let window = window(&event, from);
        let answer = driver.accelerations(std::slice::from_ref(&window))[0];
        assert_eq!(driver.simulate(&window, &[8.0], None).accel_mps2, [answer]);
    }
}

fn serving_answers_what_driving_computes(shape: DriverShape, scaling: Scaling) {
    let event = event(30, 0.4);
    let weights: Vec<f32> = weights_of(shape).into_iter().map(|w| w as f32).collect();
    let driver = Driver::new(shape, scaling, weights.clone()).unwrap();
    let mut drive = Drive::<f32>::new(shape);
    drive.forward(&Network::new(shape.layout(), &weights), &scaling, &[&event], Loop::Closed);
    let simulation = driver.simulate(&window(&event, 0), &event.leader_speed_mps()[SHAPE.horizon..], None);
    assert_eq!((simulation.differing_steps, drive.acted_steps(0), drive.held_steps(0)), (0, 0, 0));
    for t in SHAPE.horizon..30 {
        let at = t - SHAPE.horizon;
        assert!((simulation.accel_mps2[at] - drive.accel_mps2(t, 0)).abs() < 1e-4);
        assert!((simulation.spacing_m[at] - drive.spacing_m(t, 0)).abs() < 1e-3);
        assert!((simulation.follower_speed_mps[at] - drive.speed_mps(t, 0)).abs() < 1e-4);
    }
}

#[test]
fn a_bounded_drive_is_what_is_served_and_never_touches_the_leader() {
    // The leader stands still 12 m ahead of a car at 8 m/s, and the network's range ends at 2 m/s².
    let event = Event::new(0.1, vec![12.0; 40], vec![8.0; 40], vec![0.0; 40]);
    let weights: Vec<f32> = weights().into_iter().map(|w| w as f32).collect();
    let envelope = Some(Envelope::new(SHAPE.dt_s));
    let driver = Driver::new(SHAPE, SCALING, weights.clone()).unwrap();
    let leader = &event.leader_speed_mps()[SHAPE.horizon..];
    let bounded = driver.simulate(&window(&event, 0), leader, envelope);
    let alone = driver.simulate(&window(&event, 0), leader, None);
    assert!(alone.spacing_m.iter().any(|&s| s <= 0.0), "the case is meant to be hard");
    assert!(bounded.spacing_m.iter().all(|&s| s > 0.0) && bounded.follower_speed_mps.iter().all(|&v| v >= 0.0));
    assert!(bounded.differing_steps > 0);
    let mut drive = Drive::<f32>::new(SHAPE);
    drive.bound(envelope);
    drive.forward(&Network::new(SHAPE.layout(), &weights), &SCALING, &[&event], Loop::Closed);
    assert_eq!((drive.acted_steps(0) + drive.held_steps(0)) as usize, bounded.differing_steps);
    for t in SHAPE.horizon..40 {
        assert!((bounded.spacing_m[t - SHAPE.horizon] - drive.spacing_m(t, 0)).abs() < 1e-3);
    }
}

#[test]
fn a_window_gets_the_same_bits_whoever_shares_its_batch() {
    let shape = DriverShape { hidden: 19, ..SHAPE };
    let weights = initial_weights(Layout { hidden: 19, inputs: INPUTS }, 1);
    let driver = Driver::new(shape, SCALING, weights).unwrap();
    let events: Vec<_> = (0..9).map(|i| event(15, i as f32)).collect();
    let windows: Vec<_> = events.iter().flat_map(|e| (0..11).map(|from| window(e, from))).collect();
    let together = driver.accelerations(&windows);
    for (window, accel) in windows.iter().zip(&together) {
        assert_eq!(driver.accelerations(std::slice::from_ref(window))[0].to_bits(), accel.to_bits());
    }
}

#[test]
fn a_driver_refuses_weights_of_another_shape() {
    assert!(Driver::new(SHAPE, SCALING, vec![0.0; 3]).is_none());
}
