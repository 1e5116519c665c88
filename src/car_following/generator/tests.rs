//! What every generated event must be.

use proptest::prelude::*;

use super::*;

fn events(regime: TrafficRegime, seed: u64, count: usize) -> Vec<Event> {
    generate(regime, seed, count, &TrafficSettings::default()).into_iter().map(|generated| generated.event).collect()
}

fn is_physical(event: &Event) -> Result<(), String> {
    let dt = event.dt_s();
    let (s, v, l) = (event.spacing_m(), event.follower_speed_mps(), event.leader_speed_mps());
    for t in 0..event.steps() {
        if v[t] < 0.0 || l[t] < 0.0 || s[t] < 0.8 {
            return Err(format!("step {t}: spacing {}, follower {}, leader {}", s[t], v[t], l[t]));
        }
    }
    for t in 0..event.steps() - 1 {
        let mean = |x: &[f32]| f64::midpoint(f64::from(x[t]), f64::from(x[t + 1]));
        let residual = f64::from(s[t + 1]) - f64::from(s[t]) - dt * (mean(l) - mean(v));
        if residual.abs() > 2e-5 {
            return Err(format!("step {t}: the spacing is off by {residual} m"));
        }
        for x in [v, l] {
            let accel = f64::from(x[t + 1] - x[t]) / dt;
            if accel.abs() > 8.0 {
                return Err(format!("step {t}: {accel} m/s²"));
            }
        }
    }
    Ok(())
}

#[test]
fn the_same_key_gives_the_same_bits_and_another_seed_others() {
    for regime in TrafficRegime::ALL {
        let settings = TrafficSettings::default();
        let few = generate(regime, 7, 3, &settings);
        assert_eq!(few, generate(regime, 7, 5, &settings)[..3], "an event depends on what is generated beside it");
        assert_ne!(few[0].event, generate(regime, 8, 1, &settings)[0].event);
        assert_ne!(few[0].event, few[1].event);
    }
}

#[test]
fn names_tell_events_and_runs_apart() {
    let all: Vec<GeneratedEvent> =
        TrafficRegime::ALL.iter().flat_map(|&regime| generate(regime, 42, 20, &TrafficSettings::default())).collect();
    let distinct = |names: Vec<&String>| names.iter().collect::<std::collections::BTreeSet<_>>().len();
    assert_eq!(distinct(all.iter().map(|g| &g.event_id).collect()), 60);
    assert_eq!(distinct(all.iter().map(|g| &g.run).collect()), 60);
    assert!(all.iter().all(|g| g.source == "generated"));
}

#[test]
fn lengths_vary_within_the_settings() {
    let lengths: Vec<usize> = events(TrafficRegime::Middle, 1, 60).iter().map(Event::steps).collect();
    assert!(lengths.iter().all(|n| (150..=200).contains(n)));
    assert!(lengths.iter().any(|&n| n < 165) && lengths.iter().any(|&n| n > 185));
}

#[test]
fn congestion_stops_and_goes_while_the_motorway_flows() {
    let stands = |event: &Event| event.follower_speed_mps().iter().any(|&v| v < 0.1);
    let slow = events(TrafficRegime::Slow, 3, 60);
    assert!(slow.iter().filter(|event| stands(event)).count() > 20);
    assert!(!events(TrafficRegime::Fast, 3, 60).iter().any(stands));
}

#[test]
fn driving_is_calm_on_the_motorway_and_harsh_in_congestion() {
    let harshness_mps2 = |regime| {
        let squares: Vec<f64> = events(regime, 4, 40)
            .iter()
            .flat_map(|e| e.follower_speed_mps().windows(2).map(|v| f64::from(v[1] - v[0]) / 0.1).collect::<Vec<_>>())
            .map(|accel| accel * accel)
            .collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let [fast, middle, slow] = TrafficRegime::ALL.map(harshness_mps2);
    assert!(1.3 * fast < middle && 1.1 * middle < slow, "{fast} {middle} {slow}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_event_is_physical_and_in_its_band(seed: u64, which in 0usize..3) {
        let regime = TrafficRegime::ALL[which];
        for event in events(regime, seed, 8) {
            prop_assert_eq!(is_physical(&event), Ok(()));
            let [low, high] = regime.mean_speed_mps();
            prop_assert!((low..=high).contains(&event.mean_speed_mps()));
        }
    }
}

#[test]
fn a_good_part_of_the_candidates_is_accepted() {
    for regime in TrafficRegime::ALL {
        let settings = TrafficSettings::default();
        let accepted = (0..200)
            .filter(|&index| {
                let event = candidate(regime, &mut Noise::keyed([11, regime as u64, index, 0]), &settings);
                is_plausible(&event, regime, settings.min_steps)
            })
            .count();
        assert!(accepted > 100, "{regime:?}: {accepted} of 200");
    }
}
