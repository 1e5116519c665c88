//! A network's closed-loop errors on events.

use rayon::ThreadPool;

use super::Errors;
use crate::car_following::Event;
use crate::driver::{Crew, Drive, DriverShape, Loop, Scaling};
use crate::lstm::Network;
use crate::safety::{Envelope, Trajectory};

/// Drives every event closed loop with these weights; events no longer than the horizon are left out.
#[must_use]
pub fn evaluate(
    shape: DriverShape,
    scaling: &Scaling,
    weights: &[f32],
    events: &[Event],
    workers: &ThreadPool,
) -> Errors {
    let long_enough: Vec<_> = events.iter().filter(|event| event.steps() > shape.horizon).collect();
    drive_all(&Crew::new(shape, workers), shape.horizon, scaling, weights, &long_enough)
}

/// Drives `events`, each longer than the horizon, closed loop with the buffers of `crew`.
pub fn drive_all(
    crew: &Crew<'_, f32>,
    horizon: usize,
    scaling: &Scaling,
    weights: &[f32],
    events: &[&Event],
) -> Errors {
    let mut total = Errors::default();
    let network = Network::new(crew.shape().layout(), weights);
    let part = |drive: &mut Drive<f32>, piece: &[&Event]| {
        drive.forward(&network, scaling, piece, Loop::Closed);
        errors(drive, horizon, piece)
    };
    crew.each(events, part, |part| total += part);
    total
}

/// Closed-loop errors of what is served, and how much of it is not the network's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServedErrors {
    /// Of the bounded driver.
    pub errors: Errors,
    /// Simulated steps on which the envelope acted for the leader's sake.
    pub acted_steps: u64,
    /// Simulated steps on which it kept the follower from driving backwards.
    pub held_steps: u64,
}

/// As [`evaluate`], with the network bounded by an envelope: what a server drives.
#[must_use]
pub fn evaluate_served(
    shape: DriverShape,
    scaling: &Scaling,
    weights: &[f32],
    events: &[Event],
    workers: &ThreadPool,
) -> ServedErrors {
    let long_enough: Vec<_> = events.iter().filter(|event| event.steps() > shape.horizon).collect();
    let mut total = ServedErrors::default();
    let network = Network::new(shape.layout(), weights);
    let part = |drive: &mut Drive<f32>, piece: &[&Event]| {
        drive.bound(Some(Envelope::new(shape.dt_s)));
        drive.forward(&network, scaling, piece, Loop::Closed);
        let steps = |of: fn(&Drive<f32>, usize) -> u32| (0..piece.len()).map(|n| u64::from(of(drive, n))).sum();
        ServedErrors {
            errors: errors(drive, shape.horizon, piece),
            acted_steps: steps(Drive::acted_steps),
            held_steps: steps(Drive::held_steps),
        }
    };
    Crew::new(shape, workers).each(&long_enough, part, |part| {
        total.errors += part.errors;
        total.acted_steps += part.acted_steps;
        total.held_steps += part.held_steps;
    });
    total
}

/// What a network makes of each event closed loop, in their order, within an envelope or alone.
///
/// # Panics
/// When an event is not longer than the horizon.
#[must_use]
pub fn drive_events(
    shape: DriverShape,
    scaling: &Scaling,
    weights: &[f32],
    envelope: Option<Envelope>,
    events: &[Event],
    workers: &ThreadPool,
) -> Vec<Trajectory> {
    // A crew sorts by length and keeps the order of equals, so sorting alike beforehand tells whose drive is whose.
    let mut order: Vec<usize> = (0..events.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(events[i].steps()));
    let sorted: Vec<&Event> = order.iter().map(|&i| &events[i]).collect();
    let network = Network::new(shape.layout(), weights);
    let part = |drive: &mut Drive<f32>, piece: &[&Event]| {
        drive.bound(envelope);
        drive.forward(&network, scaling, piece, Loop::Closed);
        (0..piece.len()).map(|n| driven(drive, n)).collect::<Vec<_>>()
    };
    let (mut drives, mut next) = (vec![Trajectory::default(); events.len()], order.into_iter());
    Crew::new(shape, workers).each(&sorted, part, |part| {
        for driven in part {
            drives[next.next().expect("one drive an event")] = driven;
        }
    });
    drives
}

fn driven(drive: &Drive<f32>, n: usize) -> Trajectory {
    Trajectory {
        spacing_m: (0..drive.steps(n)).map(|t| drive.spacing_m(t, n)).collect(),
        follower_speed_mps: (0..drive.steps(n)).map(|t| drive.speed_mps(t, n)).collect(),
        acted_steps: drive.acted_steps(n).into(),
        held_steps: drive.held_steps(n).into(),
    }
}

fn errors(drive: &Drive<f32>, horizon: usize, events: &[&Event]) -> Errors {
    let mut sums = Errors::default();
    for (n, event) in events.iter().enumerate() {
        sums.add(event, horizon, |t| (drive.spacing_m(t, n), drive.speed_mps(t, n)));
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lstm::initial_weights;
    use crate::safety::{StressSettings, stress_set};

    const SHAPE: DriverShape = DriverShape { hidden: 6, horizon: 5, accel_limit_mps2: 4.0, ..DriverShape::PAPER };

    /// An untrained network, and one that always accelerates as hard as it can.
    fn networks() -> [Vec<f32>; 2] {
        let layout = SHAPE.layout();
        let untrained = initial_weights(layout, 3);
        let mut always = untrained.clone();
        *always.last_mut().unwrap() = 50.0;
        [untrained, always]
    }

    fn scaling() -> Scaling {
        Scaling {
            mean: [12.0, 12.0, 0.0, 20.0],
            spread: [6.0, 6.0, 2.0, 12.0],
            low: [0.0; 4],
            high: [40.0; 4],
            motion: None,
        }
    }

    #[test]
    fn within_the_envelope_no_network_collides_where_it_can_be_avoided() {
        let set = stress_set(&StressSettings { dt_s: 0.1, horizon: SHAPE.horizon, per_class: 64, seed: 42 });
        let events: Vec<Event> = set.iter().map(|scenario| scenario.event.clone()).collect();
        let workers = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        for weights in networks() {
            let drive = |envelope| drive_events(SHAPE, &scaling(), &weights, envelope, &events, &workers);
            let (alone, served) = (drive(None), drive(Some(Envelope::new(SHAPE.dt_s))));
            let collided = |driven: &[Trajectory]| {
                let pairs = set.iter().zip(driven);
                pairs.filter(|(scenario, driven)| scenario.avoidable && driven.collides(SHAPE.horizon)).count()
            };
            assert!(collided(&alone) > set.len() / 4, "the case is meant to be hard");
            assert_eq!(collided(&served), 0);
            assert!(served.iter().flat_map(|driven| &driven.follower_speed_mps).all(|&v| v >= 0.0));
            assert!(served.iter().any(|driven| driven.acted_steps > 0));
            assert!(alone.iter().all(|driven| driven.acted_steps == 0));
        }
    }

    #[test]
    fn drives_come_in_the_order_of_their_events_and_add_up_to_the_errors() {
        let [weights, _] = networks();
        let event =
            |steps: usize, spacing: f32| Event::new(0.1, vec![spacing; steps], vec![10.0; steps], vec![10.0; steps]);
        let events = [event(30, 20.0), event(40, 30.0), event(30, 40.0), event(50, 25.0)];
        let workers = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let drives = drive_events(SHAPE, &scaling(), &weights, None, &events, &workers);
        let mut sums = Errors::default();
        for (event, driven) in events.iter().zip(&drives) {
            assert_eq!((driven.spacing_m.len(), driven.spacing_m[0]), (event.steps(), event.spacing_m()[0]));
            sums += Errors::of(event, SHAPE.horizon, driven);
        }
        let whole = evaluate(SHAPE, &scaling(), &weights, &events, &workers);
        assert_eq!((whole.steps, whole.events), (sums.steps, sums.events));
        assert!((whole.spacing_sq - sums.spacing_sq).abs() < 1e-9 * whole.spacing_sq);
        let served = evaluate_served(SHAPE, &scaling(), &weights, &events, &workers);
        assert_eq!((served.errors, served.acted_steps, served.held_steps), (whole, 0, 0), "nothing here is dangerous");
    }
}
