//! The set is what it says, and the envelope passes it behind any network.

use super::*;
use crate::safety::Envelope;

fn published() -> (StressSettings, Vec<StressScenario>) {
    let settings = StressSettings::published(0.1, 10);
    (settings, stress_set(&settings))
}

fn served(scenario: &StressScenario, horizon: usize, mut raw: impl FnMut(usize) -> f32) -> Trajectory {
    let envelope = Envelope::new(scenario.event.dt_s() as f32);
    Trajectory::by_rule(&scenario.event, horizon, |t, s, v, l| {
        envelope.served_mps2(raw(t), s as f32, v as f32, l as f32).into()
    })
}

#[test]
fn the_set_is_the_same_for_a_seed_and_at_least_half_of_it_can_be_survived() {
    let (settings, set) = published();
    assert_eq!(set, stress_set(&settings));
    assert_ne!(set, stress_set(&StressSettings { seed: 43, ..settings }));
    assert!(set.is_sorted_by(|a, b| a.event.steps() >= b.event.steps()));
    for class in StressClass::ALL {
        let of_class: Vec<_> = set.iter().filter(|scenario| scenario.class == class).collect();
        let avoidable = of_class.iter().filter(|scenario| scenario.avoidable).count();
        assert_eq!(of_class.len(), settings.per_class);
        assert!(2 * avoidable >= of_class.len(), "{class:?}: {avoidable} of {}", of_class.len());
        // Whoever stops behind a leader that goes on again has room; the others hold what nobody could avoid.
        let hopeless = matches!(class, StressClass::Braking | StressClass::CutIn);
        assert!(avoidable < of_class.len() || !hopeless, "{class:?} is not hard");
    }
}

#[test]
fn leaders_brake_at_up_to_eight_stand_at_the_end_of_most_and_windows_are_plausible() {
    let (settings, set) = published();
    let mut hardest = 0.0_f32;
    for StressScenario { class, event, .. } in &set {
        let leader = event.leader_speed_mps();
        let from = settings.horizon;
        for t in from..event.steps() {
            hardest = hardest.max((leader[t - 1] - leader[t]) / 0.1);
        }
        assert!(leader.iter().all(|&v| (0.0..45.0).contains(&v)));
        assert!(event.spacing_m()[..from].iter().all(|&s| s > 0.1), "{class:?}");
        let window = &event.spacing_m()[..from - 1];
        assert!(window.windows(2).all(|s| (s[1] - s[0]).abs() < 0.5), "a follower at constant speed");
        assert!(event.steps() <= 900, "{} steps", event.steps());
    }
    assert!((7.9..8.001).contains(&hardest), "{hardest}");
    let cuts = set.iter().filter(|scenario| scenario.class == StressClass::CutIn);
    assert!(cuts.filter(|cut| cut.event.spacing_m()[settings.horizon - 1] < 0.5).count() > 10);
}

#[test]
fn nobody_within_the_envelope_collides_where_it_can_be_avoided() {
    let (settings, set) = published();
    let mut unavoidable = 0;
    for scenario in &set {
        let always = served(scenario, settings.horizon, |_| 12.0);
        let swinging = served(scenario, settings.horizon, |t| if t % 7 < 3 { 4.0 } else { -4.0 });
        for driven in [always, swinging] {
            if scenario.avoidable {
                assert!(!driven.collides(settings.horizon), "{scenario:?}");
            }
            unavoidable += usize::from(driven.collides(settings.horizon));
            assert!(driven.follower_speed_mps.iter().all(|&v| v >= 0.0));
        }
    }
    assert!(unavoidable > 0, "the set holds what nobody could avoid");
}

#[test]
fn without_an_envelope_the_same_drivers_collide() {
    let (settings, set) = published();
    let collides = |s: &&StressScenario| {
        Trajectory::by_rule(&s.event, settings.horizon, |_, _, _, _| 0.0).collides(settings.horizon)
    };
    assert!(2 * set.iter().filter(collides).count() > set.len());
}
