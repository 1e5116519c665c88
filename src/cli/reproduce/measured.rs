//! What a network makes of every task's test events, alone and as it is served.

use rayon::ThreadPool;
use serde::{Deserialize, Serialize};

use super::plan::Task;
use crate::driver::DriverShape;
use crate::evaluation::{Errors, drive_events};
use crate::safety::{Envelope, Surrogates};
use crate::training::Learned;

/// Errors of each event by itself, so that events can be paired and drawn again.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Measured {
    /// The network alone: tasks × test events.
    pub(super) alone: Vec<Vec<Errors>>,
    /// Within the envelope: tasks × test events.
    pub(super) served: Vec<Vec<Errors>>,
    /// Simulated steps on which the envelope acted for the leader's sake, of each task.
    pub(super) acted_steps: Vec<u64>,
    /// Simulated steps on which it only kept the follower from driving backwards, of each task.
    pub(super) held_steps: Vec<u64>,
    /// Least time to collision of each drive of the network alone, s; none where the follower never is faster.
    pub(super) alone_min_ttc_s: Vec<Vec<Option<f64>>>,
    /// The same within the envelope.
    pub(super) served_min_ttc_s: Vec<Vec<Option<f64>>>,
}

impl Measured {
    pub(super) fn of(learned: &Learned, shape: DriverShape, tasks: &[Task], workers: &ThreadPool) -> Self {
        let mut measured = Self::default();
        for task in tasks {
            let drive =
                |envelope| drive_events(shape, &learned.scaling, &learned.weights, envelope, &task.test, workers);
            let (alone, served) = (drive(None), drive(Some(Envelope::new(shape.dt_s))));
            measured.acted_steps.push(served.iter().map(|driven| driven.acted_steps).sum());
            measured.held_steps.push(served.iter().map(|driven| driven.held_steps).sum());
            for (driven, errors, min_ttc_s) in [
                (alone, &mut measured.alone, &mut measured.alone_min_ttc_s),
                (served, &mut measured.served, &mut measured.served_min_ttc_s),
            ] {
                let each = || task.test.iter().zip(&driven);
                errors.push(each().map(|(event, driven)| Errors::of(event, shape.horizon, driven)).collect());
                let closest = |(event, driven)| Surrogates::of(event, driven, shape.horizon).min_ttc_s;
                min_ttc_s.push(each().map(closest).collect());
            }
        }
        measured
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::car_following::Event;
    use crate::driver::Scaling;
    use crate::lstm::initial_weights;

    #[test]
    fn a_car_held_at_standstill_is_not_one_acted_on_for_its_leader() {
        let shape = DriverShape { hidden: 2, horizon: 5, ..DriverShape::PAPER };
        let mut weights = initial_weights(shape.layout(), 1);
        *weights.last_mut().unwrap() = -50.0;
        let scaling = Scaling { mean: [0.0; 4], spread: [1.0; 4], low: [0.0; 4], high: [40.0; 4], motion: None };
        let learned = Learned {
            weights,
            scaling,
            memory: None,
            strength: None,
            lambda: None,
            kernel: String::new(),
            update_s: 1.0,
        };
        // Stands 30 m behind one who stands, and is asked to brake on each of 15 steps.
        let event = Event::new(0.1, vec![30.0; 20], vec![0.0; 20], vec![0.0; 20]);
        let task = Task {
            name: "standing".to_owned(),
            train: Vec::new(),
            validation: Vec::new(),
            test: vec![event.clone(), event],
            test_runs: vec!["one".to_owned(); 2],
            test_ids: vec!["a".to_owned(), "b".to_owned()],
        };
        let workers = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let measured = Measured::of(&learned, shape, &[task], &workers);
        assert_eq!((measured.held_steps, measured.acted_steps), (vec![30], vec![0]));
        assert_eq!(measured.served[0].iter().map(|errors| errors.spacing_sq).sum::<f64>(), 0.0);
        assert!(measured.alone[0].iter().all(|errors| errors.spacing_sq > 0.0), "alone it drives backwards");
    }
}
