//! One driver against the whole stress set and at the head of a platoon.

use serde::Serialize;

use super::platoon::{Platoon, PlatoonOutcome};
use super::{StressClass, StressScenario, Surrogates, Trajectory};
use crate::car_following::Event;

/// Everything measured of one driver.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SafetyReport {
    /// One entry a class of scenarios, in the order of [`StressClass::ALL`].
    pub stress: Vec<StressOutcome>,
    /// String stability.
    pub platoon: PlatoonOutcome,
}

/// A measure over several drives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// The middle one, the upper of two; none when it is infinite.
    pub median: Option<f64>,
    /// The most dangerous one; none when it is infinite.
    pub worst: Option<f64>,
}

/// How a driver fares in one class of scenarios. Surrogate measures are over the avoidable ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StressOutcome {
    /// What the leaders do.
    pub class: StressClass,
    /// Scenarios.
    pub scenarios: usize,
    /// Of these, those in which a follower that brakes at 8 m/s² one step after the leader does not collide.
    pub avoidable: usize,
    /// Scenarios in which this driver collides.
    pub collisions: usize,
    /// Of these, avoidable ones.
    pub avoidable_collisions: usize,
    /// Scenarios in which it moves backwards at some step.
    pub backwards: usize,
    /// Steps on which the envelope acted for the leader's sake, of all simulated ones, %.
    pub acted_percent: f64,
    /// Least time to collision of a drive, s.
    pub min_ttc_s: Spread,
    /// Greatest deceleration that a drive needed to avoid a crash, m/s².
    pub max_drac_mps2: Spread,
    /// Hardest braking of a drive, m/s².
    pub max_braking_mps2: Spread,
    /// Root mean square of the jerk of a drive, m/s³.
    pub jerk_rms_mps3: Spread,
    /// Greatest absolute jerk of a drive, m/s³.
    pub jerk_max_mps3: Spread,
}

/// Lets a driver drive the scenarios and the platoon. `drive` is given events and returns, in their order, what the driver
/// makes of each from step `horizon` on, the first steps being the event's own.
///
/// # Panics
/// When `drive` returns another number of drives than it was given events.
pub fn assess(
    set: &[StressScenario],
    horizon: usize,
    platoon: &Platoon,
    drive: &mut dyn FnMut(&[Event]) -> Vec<Trajectory>,
) -> SafetyReport {
    let events: Vec<Event> = set.iter().map(|scenario| scenario.event.clone()).collect();
    let driven = drive(&events);
    assert_eq!(driven.len(), set.len(), "one drive an event");
    let driven: Vec<_> = set.iter().zip(&driven).collect();
    let of_class = |class: StressClass| {
        let of_class: Vec<_> = driven.iter().filter(|(scenario, _)| scenario.class == class).copied().collect();
        outcome(class, horizon, &of_class)
    };
    SafetyReport { stress: StressClass::ALL.into_iter().map(of_class).collect(), platoon: platoon.run(drive) }
}

fn outcome(class: StressClass, horizon: usize, driven: &[(&StressScenario, &Trajectory)]) -> StressOutcome {
    let count = |holds: &dyn Fn(&StressScenario, &Trajectory) -> bool| {
        driven.iter().filter(|(scenario, driven)| holds(scenario, driven)).count()
    };
    let steps: usize = driven.iter().map(|(scenario, _)| scenario.event.steps() - horizon).sum();
    let acted: u64 = driven.iter().map(|(_, driven)| driven.acted_steps).sum();
    let measures: Vec<Surrogates> = driven
        .iter()
        .filter(|(scenario, _)| scenario.avoidable)
        .map(|(scenario, driven)| Surrogates::of(&scenario.event, driven, horizon))
        .collect();
    let high = |measure: fn(&Surrogates) -> f64| spread(measures.iter().map(|m| -measure(m)).collect(), -1.0);
    StressOutcome {
        class,
        scenarios: driven.len(),
        avoidable: measures.len(),
        collisions: count(&|_, driven| driven.collides(horizon)),
        avoidable_collisions: count(&|scenario, driven| scenario.avoidable && driven.collides(horizon)),
        backwards: count(&|_, driven| driven.follower_speed_mps[horizon..].iter().any(|&speed| speed < 0.0)),
        acted_percent: 100.0 * acted as f64 / steps.max(1) as f64,
        min_ttc_s: Spread::of_least(measures.iter().map(|m| m.min_ttc_s)),
        max_drac_mps2: high(|m| m.max_drac_mps2),
        max_braking_mps2: high(|m| m.max_braking_mps2),
        jerk_rms_mps3: high(|m| m.jerk_rms_mps3),
        jerk_max_mps3: high(|m| m.jerk_max_mps3),
    }
}

impl Spread {
    /// Of what is more dangerous the less it is; none is infinite.
    #[must_use]
    pub fn of_least(values: impl Iterator<Item = Option<f64>>) -> Self {
        spread(values.map(|value| value.unwrap_or(f64::INFINITY)).collect(), 1.0)
    }
}

/// Middle and least of `values`, times `sign`.
fn spread(mut values: Vec<f64>, sign: f64) -> Spread {
    values.sort_by(f64::total_cmp);
    let finite = |value: &f64| value.is_finite().then_some(sign * value);
    Spread { median: values.get(values.len() / 2).and_then(finite), worst: values.first().and_then(finite) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::car_following::Idm;
    use crate::safety::{StressSettings, stress_set};

    const HORIZON: usize = 10;
    const IDM: Idm = Idm {
        desired_speed_mps: 36.0,
        time_headway_s: 1.2,
        jam_spacing_m: 2.0,
        max_accel_mps2: 1.2,
        comfortable_braking_mps2: 2.0,
    };

    fn report(mut accel: impl FnMut(f64, f64, f64) -> f64) -> SafetyReport {
        let set = stress_set(&StressSettings { dt_s: 0.1, horizon: HORIZON, per_class: 24, seed: 1 });
        let platoon = Platoon { cars: 3, periods_s: vec![10.0], ..Platoon::published(0.1, HORIZON) };
        assess(&set, HORIZON, &platoon, &mut |events| {
            events.iter().map(|e| Trajectory::by_rule(e, HORIZON, |_, s, v, l| accel(s, v, l))).collect()
        })
    }

    #[test]
    fn a_careful_driver_is_safer_than_one_who_sees_nothing() {
        let (careful, blind) = (report(|s, v, l| IDM.accel_mps2(s, v, l)), report(|_, _, _| 0.0));
        for (careful, blind) in careful.stress.iter().zip(&blind.stress) {
            assert_eq!((careful.scenarios, careful.avoidable), (24, blind.avoidable));
            assert!(careful.collisions < blind.collisions);
            assert!(careful.avoidable_collisions <= careful.collisions && blind.collisions <= 24);
            assert_eq!(blind.min_ttc_s.worst, Some(0.0), "a collision");
            assert_eq!(blind.max_braking_mps2.worst, Some(0.0));
            assert!(careful.max_braking_mps2.worst >= careful.max_braking_mps2.median);
        }
    }

    #[test]
    fn the_worst_is_the_least_time_and_the_greatest_braking() {
        let times = Spread::of_least([Some(3.0), None, Some(1.0)].into_iter());
        assert_eq!((times.median, times.worst), (Some(3.0), Some(1.0)));
        let braking = spread(vec![-3.0, -7.0, -1.0], -1.0);
        assert_eq!((braking.median, braking.worst), (Some(3.0), Some(7.0)));
        assert_eq!(Spread::of_least([None].into_iter()).worst, None);
        assert_eq!(Spread::of_least([].into_iter()).median, None);
    }
}
