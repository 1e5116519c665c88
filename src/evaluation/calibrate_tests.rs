use super::*;
use crate::car_following::{FollowerState, Idm, TrafficRegime, TrafficSettings, generate};
use crate::evaluation::evaluate_reference;

const HORIZON: usize = 10;

fn workers(threads: usize) -> ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

fn generated(regime: TrafficRegime, seed: u64, events: usize) -> Vec<Event> {
    let settings = TrafficSettings { max_steps: 150, ..TrafficSettings::default() };
    generate(regime, seed, events, &settings).into_iter().map(|generated| generated.event).collect()
}

fn mse(errors: Errors) -> f64 {
    errors.spacing_sq / errors.steps as f64
}

fn quick() -> CalibrationSettings {
    CalibrationSettings { evaluations: 400, ..CalibrationSettings::default() }
}

/// The same leaders, followed from the first step on by one and the same driver.
fn followed_by(idm: Idm, events: &[Event]) -> Vec<Event> {
    let follow = |event: &Event| {
        let leader = event.leader_speed_mps();
        let first =
            FollowerState { spacing_m: event.spacing_m()[0].into(), speed_mps: event.follower_speed_mps()[0].into() };
        let (mut now, mut spacing, mut speed) =
            (first, vec![event.spacing_m()[0]], vec![event.follower_speed_mps()[0]]);
        for pair in leader.windows(2) {
            let accel = idm.accel_mps2(now.spacing_m, now.speed_mps, pair[0].into());
            now = now.advanced(accel, [pair[0].into(), pair[1].into()], event.dt_s());
            spacing.push(now.spacing_m as f32);
            speed.push(now.speed_mps as f32);
        }
        Event::new(event.dt_s(), spacing, speed, leader.to_vec())
    };
    events.iter().map(follow).collect()
}

#[test]
fn a_driver_who_is_an_idm_is_found_again() {
    let hidden = Idm {
        desired_speed_mps: 22.0,
        time_headway_s: 1.1,
        jam_spacing_m: 2.5,
        max_accel_mps2: 1.4,
        comfortable_braking_mps2: 2.2,
    };
    let events = followed_by(hidden, &generated(TrafficRegime::Middle, 5, 60));
    let (train, test) = events.split_at(40);
    let borrowed: Vec<_> = train.iter().collect();
    let found = calibrate(ReferenceKind::Idm, HORIZON, &borrowed, &CalibrationSettings::default(), &workers(2));
    let before = mse(evaluate_reference(&ReferenceKind::Idm.published(), HORIZON, test, &workers(1)));
    let after = mse(evaluate_reference(&found.driver, HORIZON, test, &workers(1)));
    assert!(after < 0.01 && after < 0.001 * before, "{before} m² before, {after} m² after: {:?}", found.driver);
}

#[test]
fn people_who_differ_are_followed_about_as_well_as_by_the_mean_driver_they_were_drawn_around() {
    // `car_following::generate` draws slow traffic around this driver.
    let mean = Idm {
        desired_speed_mps: 20.0,
        time_headway_s: 1.3,
        jam_spacing_m: 2.4,
        max_accel_mps2: 1.6,
        comfortable_braking_mps2: 2.2,
    };
    let (train, test) = (generated(TrafficRegime::Slow, 6, 80), generated(TrafficRegime::Slow, 7, 80));
    let borrowed: Vec<_> = train.iter().collect();
    let found = calibrate(ReferenceKind::Idm, HORIZON, &borrowed, &quick(), &workers(2));
    let floor = mse(evaluate_reference(&ReferenceDriver::Idm(mean), HORIZON, &test, &workers(1)));
    let reached = mse(evaluate_reference(&found.driver, HORIZON, &test, &workers(1)));
    assert!(reached < 1.1 * floor, "{floor} m² by the mean driver, {reached} m² by {:?}", found.driver);
}

#[test]
fn calibration_is_never_worse_than_the_published_parameters_however_short() {
    let events = generated(TrafficRegime::Fast, 8, 20);
    let borrowed: Vec<_> = events.iter().collect();
    for kind in ReferenceKind::ALL {
        let published = mse(evaluate_reference(&kind.published(), HORIZON, &events, &workers(1)));
        for evaluations in [1, 9, 60] {
            let settings =
                CalibrationSettings { evaluations, collision_penalty: 0.0, ..CalibrationSettings::default() };
            let found = calibrate(kind, HORIZON, &borrowed, &settings, &workers(1));
            assert!(found.evaluations <= evaluations, "{evaluations} asked for, {} made", found.evaluations);
            assert!(mse(found.on) <= published + 1e-9, "{} of {published} m² after {evaluations}", mse(found.on));
        }
    }
}

#[test]
fn the_bits_depend_on_the_set_of_events_and_the_seed_alone() {
    let events = generated(TrafficRegime::Slow, 9, 50);
    let (mut borrowed, settings): (Vec<_>, _) = (events.iter().collect(), quick());
    for kind in [ReferenceKind::Idm, ReferenceKind::Gipps] {
        let one = calibrate(kind, HORIZON, &borrowed, &settings, &workers(1));
        borrowed.reverse();
        let three = calibrate(kind, HORIZON, &borrowed, &settings, &workers(3));
        assert_eq!(one, three);
        let other = CalibrationSettings { seed: 1, ..settings.clone() };
        assert_ne!(one.driver, calibrate(kind, HORIZON, &borrowed, &other, &workers(1)).driver);
    }
}

#[test]
fn what_is_found_lies_within_its_bounds() {
    let events = generated(TrafficRegime::Fast, 10, 12);
    let borrowed: Vec<_> = events.iter().collect();
    for kind in ReferenceKind::ALL {
        let found = calibrate(kind, HORIZON, &borrowed, &quick(), &workers(1));
        for (parameter, value) in kind.parameters().iter().zip(found.driver.values()) {
            assert!((parameter.low..=parameter.high).contains(&value), "{parameter:?}: {value}");
        }
        assert_eq!(found.driver, found.driver.in_steps_of(0.1), "what is told is what was driven");
    }
}

#[test]
fn events_are_bounded_in_number_and_steps() {
    let events = generated(TrafficRegime::Fast, 11, 12);
    let borrowed: Vec<_> = events.iter().collect();
    let on = |max_events, max_steps| {
        let settings = CalibrationSettings { evaluations: 1, max_events, max_steps, ..CalibrationSettings::default() };
        calibrate(ReferenceKind::Idm, HORIZON, &borrowed, &settings, &workers(1)).on.events
    };
    assert_eq!([on(100, 1_000_000), on(5, 1_000_000), on(100, 450), on(100, 449)], [12, 5, 3, 2]);
}

#[test]
fn without_events_the_published_parameters_stand() {
    let short = Event::new(0.1, vec![9.0; HORIZON], vec![5.0; HORIZON], vec![5.0; HORIZON]);
    for events in [&[][..], &[&short]] {
        let found = calibrate(ReferenceKind::Gipps, HORIZON, events, &quick(), &workers(1));
        assert_eq!((found.driver, found.on.events, found.evaluations), (ReferenceKind::Gipps.published(), 0, 0));
    }
}

#[test]
fn places_outside_the_bounds_are_mirrored() {
    for (x, inside) in [(0.3, 0.3), (-0.2, 0.2), (1.2, 0.8), (2.0, 0.0), (-1.0, 1.0), (3.4, 0.6)] {
        assert!((mirrored(x) - inside).abs() < 1e-12, "{x}");
    }
}
