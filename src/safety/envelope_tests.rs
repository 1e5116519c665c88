//! What the envelope promises, on drives that are as hostile as the assumptions allow.

use proptest::prelude::*;

use super::*;

/// The steps that are tried: the default, `HighD`'s, one that no f32 holds well, a slow one.
const STEPS_S: [f32; 4] = [0.1, 0.04, 0.03, 0.5];

fn steps_s() -> impl Strategy<Value = f32> {
    (0..STEPS_S.len()).prop_map(|at| STEPS_S[at])
}

#[derive(Debug, Clone, Copy)]
struct State {
    s: f32,
    v: f32,
    l: f32,
}

/// One step of the integrator in f32, as drives compute it.
fn advanced(now: State, a: f32, next_l: f32, dt: f32) -> State {
    let v = now.v + dt * a;
    State { s: now.s + dt * (0.5 * (now.l + next_l) - 0.5 * (now.v + v)), v, l: next_l }
}

/// The greatest admissible acceleration found by trying.
fn by_bisection(envelope: Envelope, now: State, dt: f64) -> f64 {
    let (s, v, l) = (f64::from(now.s), f64::from(now.v), f64::from(now.l));
    let worst = (l - HARDEST_BRAKING_MPS2 * dt).max(0.0);
    let safe_after = |a: f64| {
        let next = v + dt * a;
        envelope.is_safe(s + dt * (f64::midpoint(l, worst) - f64::midpoint(v, next)), next, worst)
    };
    let (mut low, mut high) = ((-v / dt).max(-HARDEST_BRAKING_MPS2), 100.0 / dt);
    if !safe_after(low) {
        return low;
    }
    for _ in 0..200 {
        let middle = f64::midpoint(low, high);
        if safe_after(middle) { low = middle } else { high = middle }
    }
    low
}

#[test]
fn stopping_distances_are_those_of_the_integrator() {
    for dt in STEPS_S {
        let (envelope, dt) = (Envelope::new(dt), f64::from(dt));
        for start in [0.0, 0.3, 0.8, 1.0, 7.99, 13.0, 33.3, 60.0_f64] {
            let (mut v, mut distance) = (start, 0.0);
            while v > 0.0 {
                let next = (v - HARDEST_BRAKING_MPS2 * dt).max(0.0);
                distance += dt * f64::midpoint(v, next);
                v = next;
            }
            assert!((envelope.stopping_m(start) - distance).abs() < 1e-9, "{start} m/s in steps of {dt} s");
            let bounds = [start.powi(2) / 16.0, start.powi(2) / 16.0 + start.min(8.0 * dt) * dt / 2.0];
            assert!(bounds[0] - 1e-9 <= distance && distance <= bounds[1] + 1e-9);
        }
    }
}

#[test]
fn a_standing_car_stays_behind_a_standing_leader_and_follows_when_it_goes() {
    let envelope = Envelope::new(0.1);
    for start in [0.05, 0.2, 0.3, 1.0] {
        let mut now = State { s: start, v: 0.0, l: 0.0 };
        for _ in 0..100 {
            now = advanced(now, envelope.served_mps2(4.0, now.s, now.v, now.l), 0.0, 0.1);
        }
        assert!(now.v < 1e-3 && now.s >= start.min(0.199), "{now:?}");
        for _ in 0..100 {
            now = advanced(now, envelope.served_mps2(4.0, now.s, now.v, now.l), (now.l + 0.15).min(10.0), 0.1);
        }
        assert!(now.v > 9.0, "it follows: {now:?}");
    }
}

#[test]
fn a_network_that_is_no_number_is_not_hidden() {
    assert!(Envelope::new(0.1).served_mps2(f32::NAN, 20.0, 10.0, 10.0).is_nan());
}

#[test]
fn the_cause_tells_a_held_car_from_a_bounded_one() {
    let envelope = Envelope::new(0.1);
    let cause = |raw, s, v, l| envelope.bounded(raw, s, v, l).cause;
    assert_eq!(cause(-0.1, 5.0, 0.0, 0.0), Some(Cause::Standstill));
    assert_eq!(cause(1.0, 0.5, 10.0, 10.0), Some(Cause::Leader));
    assert_eq!(cause(1.0, 30.0, 10.0, 10.0), None);
    // Both cars stand too close: to hold is what the network wants, too.
    assert_eq!(cause(0.0, 0.05, 0.0, 0.0), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn nothing_collides_from_a_safe_state_whatever_network_and_leader_do(
        dt in steps_s(), v in 0.0..50.0f32, l in 0.0..50.0f32, excess in 0.0..5.0f32,
        moves in prop::collection::vec((-12.0..12.0f32, -1.0..0.6f32), 1..200), stubborn in any::<bool>(),
    ) {
        let envelope = Envelope::new(dt);
        let needed = (envelope.stopping_m(v.into()) - envelope.stopping_m(l.into())).max(0.0) + MARGIN_M;
        let mut now = State { s: needed as f32 + excess, v, l };
        for (raw, leader) in moves {
            // The leader brakes at up to 8 m/s², and fully more often than not.
            let change = if leader < -0.4 { -8.0 } else { 8.0 * leader };
            let next_l = (now.l + dt * change).max(0.0);
            let raw = if stubborn { 12.0 } else { raw };
            now = advanced(now, envelope.served_mps2(raw, now.s, now.v, now.l), next_l, dt);
            prop_assert!(now.s > 0.9 * MARGIN_M as f32, "{now:?}");
            prop_assert!(now.v >= 0.0, "{now:?}");
        }
    }

    #[test]
    fn the_bound_is_the_greatest_admissible_acceleration(
        dt in steps_s(), s in -1.0..120.0f32, v in 0.0..50.0f32, l in 0.0..50.0f32,
    ) {
        let now = State { s, v, l };
        let envelope = Envelope::new(dt);
        let bound = f64::from(envelope.served_mps2(1e9, s, v, l));
        let tried = by_bisection(envelope, now, dt.into());
        if tried < 0.99 * 100.0 / f64::from(dt) {
            let tolerance = 1e-6 * (1.0 + tried.abs() + f64::from(v + l + s.abs()) / f64::from(dt).powi(2));
            prop_assert!((bound - tried).abs() < tolerance, "{bound} against {tried}");
        }
    }

    #[test]
    fn what_is_admissible_is_served_as_it_is(
        dt in steps_s(), s in 0.0..120.0f32, v in 0.0..50.0f32, l in 0.0..50.0f32, raw in -12.0..12.0f32,
    ) {
        let envelope = Envelope::new(dt);
        let served = envelope.served_mps2(raw, s, v, l);
        let bound = envelope.served_mps2(1e9, s, v, l);
        if raw <= bound && f64::from(v) + f64::from(dt) * 1.001 * f64::from(raw) >= 0.0 {
            prop_assert_eq!(served.to_bits(), raw.to_bits());
        }
        prop_assert!(served <= bound);
    }

    #[test]
    fn more_room_a_faster_leader_and_a_greater_wish_never_mean_less(
        dt in steps_s(), s in -1.0..120.0f32, v in -1.0..50.0f32, l in -1.0..50.0f32, raw in -12.0..12.0f32,
        more in 0.0..10.0f32,
    ) {
        let envelope = Envelope::new(dt);
        let served = envelope.served_mps2(raw, s, v, l);
        prop_assert!(envelope.served_mps2(raw, s + more, v, l) >= served);
        prop_assert!(envelope.served_mps2(raw, s, v, l + more) >= served);
        prop_assert!(envelope.served_mps2(raw + more, s, v, l) >= served);
    }

    #[test]
    fn nobody_moves_backwards_in_single_or_double_precision(
        dt in steps_s(), s in -10.0..100.0f32, v in 0.0..60.0f32, l in 0.0..60.0f32, raw in -12.0..12.0f32,
    ) {
        let served = Envelope::new(dt).served_mps2(raw, s, v, l);
        prop_assert!(v + dt * served >= 0.0);
        prop_assert!(dt.mul_add(served, v) >= 0.0);
        // The same step as a client writes it: 0.1 as a double.
        let written: f64 = dt.to_string().parse().unwrap();
        prop_assert!(f64::from(v) + written * f64::from(served) >= 0.0);
    }

    #[test]
    fn inputs_that_no_road_has_get_a_finite_answer(
        s in -1e6..1e6f32, v in -1e6..1e6f32, l in -1e6..1e6f32, raw in -12.0..12.0f32,
    ) {
        prop_assert!(Envelope::new(0.1).served_mps2(raw, s, v, l).is_finite());
    }
}
