use proptest::prelude::*;

use super::*;
use crate::car_following::SpacingDefinition;

const TARGET: Target = Target { dt_s: 0.1, min_steps: 12, max_steps: 6000 };

/// A leader at 10 m/s, a follower at 9: the gap opens by 0.1 m a step.
fn steady(steps: usize) -> Recording {
    Recording {
        dt_s: Some(0.1),
        t_s: None,
        spacing_m: (0..steps).map(|k| 20.0 + 0.1 * k as f64).collect(),
        follower_speed_mps: vec![9.0; steps],
        leader_speed_mps: vec![10.0; steps],
        rel_speed_mps: None,
    }
}

fn check(recording: &Recording) -> Result<Event, Vec<Defect>> {
    CheckSettings::default().check(recording, &Conversion::default(), &TARGET)
}

fn codes(recording: &Recording) -> Vec<(&'static str, Option<usize>)> {
    check(recording).unwrap_err().into_iter().map(|d| (d.code, d.step)).collect()
}

#[test]
fn a_plain_recording_is_an_event() {
    let event = check(&steady(30)).unwrap();
    assert_eq!((event.steps(), event.dt_s()), (30, 0.1));
    assert_eq!(event.spacing_m()[1], 20.1_f32);
}

#[test]
fn an_event_is_as_long_as_it_is_at_the_models_step() {
    let slow = |steps| {
        let mut recording = steady(0);
        recording.dt_s = Some(1.0);
        recording.spacing_m = (0..steps).map(|k| 20.0 + 0.1 * f64::from(k)).collect();
        recording.follower_speed_mps = vec![9.9; recording.spacing_m.len()];
        recording.leader_speed_mps = vec![10.0; recording.spacing_m.len()];
        recording
    };
    assert_eq!(check(&slow(600)).unwrap().steps(), 600);
    assert_eq!(codes(&slow(601)), [("too_many_steps", None)], "601 of 1 s are 6,001 of 0.1 s");
}

#[test]
fn each_defect_has_a_code_and_a_step() {
    let broken = |change: fn(&mut Recording)| {
        let mut recording = steady(30);
        change(&mut recording);
        codes(&recording)
    };
    assert_eq!(broken(|r| r.spacing_m[17] = -0.1), [("spacing_not_positive", Some(17))]);
    assert_eq!(broken(|r| r.spacing_m[17] = 1e-60), [("spacing_not_positive", Some(17))]);
    assert_eq!(broken(|r| r.spacing_m[17] = f64::NAN), [("not_finite", Some(17))]);
    assert_eq!(broken(|r| r.spacing_m[3] = 501.0), [("spacing_too_large", Some(3))]);
    assert_eq!(broken(|r| r.spacing_m[3] += 2.0), [("spacing_inconsistent", Some(3))]);
    assert_eq!(broken(|r| r.follower_speed_mps[5] = -0.2), [("speed_negative", Some(5))]);
    assert_eq!(broken(|r| r.leader_speed_mps[5] = 71.0), [("speed_too_high", Some(5))]);
    assert_eq!(broken(|r| r.leader_speed_mps[5] = 7.0), [("acceleration_out_of_range", Some(5))]);
    assert_eq!(broken(|r| r.rel_speed_mps = Some(vec![-1.0; 30])), [("rel_speed_mismatch", Some(0))]);
    assert_eq!(broken(|r| r.rel_speed_mps = Some(vec![1.0; 29])), [("length_mismatch", None)]);
    assert_eq!(broken(|r| r.dt_s = None), [("missing_dt", None)]);
    assert_eq!(broken(|r| r.dt_s = Some(2.0)), [("dt_out_of_range", None)]);
    assert_eq!(broken(|r| r.dt_s = Some(f64::NAN)), [("dt_out_of_range", None)]);
    assert_eq!(broken(|r| *r = Recording { dt_s: Some(0.1), ..Recording::default() }), [("no_steps", None)]);
}

#[test]
fn several_defects_are_named_at_once_and_counted() {
    let mut recording = steady(30);
    recording.spacing_m[2..5].fill(-1.0);
    recording.follower_speed_mps[7] = f64::INFINITY;
    let defects = check(&recording).unwrap_err();
    assert_eq!(defects.len(), 2);
    assert_eq!(defects[0].detail, "spacing_m at step 2 is -1 m, not above 0; so at 3 steps");
    assert_eq!(defects[1].field, Some("follower_speed_mps"));
}

#[test]
fn too_short_is_judged_at_the_models_step() {
    assert!(check(&steady(12)).is_ok());
    assert_eq!(codes(&steady(11)), [("too_short", None)]);
    let coarse = |steps| Recording { dt_s: Some(0.2), spacing_m: vec![20.0; steps], ..still(steps) };
    assert!(check(&coarse(7)).is_ok());
    assert_eq!(codes(&coarse(6)), [("too_short", None)]);
}

fn still(steps: usize) -> Recording {
    Recording { follower_speed_mps: vec![0.0; steps], leader_speed_mps: vec![0.0; steps], ..steady(steps) }
}

#[test]
fn noise_around_standstill_becomes_standstill() {
    let mut recording = Recording { spacing_m: vec![2.0; 20], ..still(20) };
    recording.follower_speed_mps[3] = -0.05;
    recording.leader_speed_mps[4] = -0.0;
    let event = check(&recording).unwrap();
    assert!(event.follower_speed_mps().iter().chain(event.leader_speed_mps()).all(|v| v.to_bits() == 0));
}

#[test]
fn swapped_vehicles_drift_apart() {
    let mut recording = steady(150);
    std::mem::swap(&mut recording.follower_speed_mps, &mut recording.leader_speed_mps);
    assert_eq!(codes(&recording), [("spacing_drifts", Some(149))]);
}

#[test]
fn times_give_the_step_unless_it_is_declared() {
    let timed = |times: Vec<f64>, dt_s| Recording { dt_s, t_s: Some(times), ..steady(20) };
    let tenths = |k: usize| 1_700_000_000.0 + 0.1 * k as f64;
    let event = check(&timed((0..20).map(tenths).collect(), None)).unwrap();
    assert_eq!(event.dt_s().to_bits(), 0.1_f64.to_bits());
    let frames = (0..20).map(f64::from).collect();
    assert_eq!(check(&timed(frames, Some(0.1))).unwrap().dt_s(), 0.1);
    let gap = (0..20).map(|k| tenths(k + usize::from(k > 9))).collect();
    assert_eq!(codes(&timed(gap, None)), [("uneven_t", Some(10))]);
    assert_eq!(codes(&timed((0..20).rev().map(tenths).collect(), None)), [("uneven_t", Some(0))]);
    assert_eq!(codes(&timed(vec![f64::NAN; 20], None)), [("not_finite", Some(0))]);
}

#[test]
fn spacing_is_made_net() {
    let net = |spacing| {
        let conversion = Conversion { dt_s: None, spacing };
        CheckSettings::default().check(&steady(20), &conversion, &TARGET).map(|e| e.spacing_m()[0])
    };
    assert_eq!(net(SpacingDefinition::Front { leader_length_m: 4.5 }).unwrap(), 15.5);
    assert_eq!(net(SpacingDefinition::Centre { leader_length_m: 5.0, follower_length_m: 4.0 }).unwrap(), 15.5);
    let defects = net(SpacingDefinition::Front { leader_length_m: 20.0 }).unwrap_err();
    assert_eq!(defects[0].detail, "spacing_m at step 0 is 20 m, not above 0 net of 20 m");
}

fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-0.0), any::<f64>(), -1.0..100.0_f64]
}

fn arrays() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(anything(), 0..30)
}

proptest! {
    #[test]
    fn any_recording_is_an_event_or_has_defects(
        dt_s in proptest::option::of(anything()),
        t_s in proptest::option::of(arrays()),
        spacing_m in arrays(),
        follower_speed_mps in arrays(),
        leader_speed_mps in arrays(),
        rel_speed_mps in proptest::option::of(arrays()),
    ) {
        let recording = Recording { dt_s, t_s, spacing_m, follower_speed_mps, leader_speed_mps, rel_speed_mps };
        match check(&recording) {
            Ok(event) => {
                prop_assert!(event.spacing_m().iter().all(|s| s.is_finite() && *s > 0.0));
                prop_assert!(event.follower_speed_mps().iter().all(|v| v.is_finite() && *v >= 0.0));
            }
            Err(defects) => prop_assert!((1..=MAX_DEFECTS).contains(&defects.len())),
        }
    }
}
