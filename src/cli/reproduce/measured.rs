//! What a network makes of every task's test events, alone and as it is served.

use rayon::ThreadPool;
use serde::{Deserialize, Serialize};

use super::plan::Plan;
use crate::driver::DriverShape;
use crate::evaluation::{Errors, drive_events};
use crate::safety::Envelope;
use crate::training::Learned;

/// Errors of each event by itself, so that events can be paired and drawn again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Measured {
    /// The network alone: tasks × test events.
    pub(super) alone: Vec<Vec<Errors>>,
    /// Within the envelope: tasks × test events.
    pub(super) served: Vec<Vec<Errors>>,
    /// Simulated steps on which the envelope acted, of each task.
    pub(super) acted_steps: Vec<u64>,
}

impl Measured {
    pub(super) fn of(learned: &Learned, shape: DriverShape, plan: &Plan, workers: &ThreadPool) -> Self {
        let mut measured = Self { alone: Vec::new(), served: Vec::new(), acted_steps: Vec::new() };
        for task in &plan.tasks {
            let drive =
                |envelope| drive_events(shape, &learned.scaling, &learned.weights, envelope, &task.test, workers);
            let (alone, served) = (drive(None), drive(Some(Envelope::new(shape.dt_s))));
            measured.acted_steps.push(served.iter().map(|driven| driven.acted_steps).sum());
            for (driven, into) in [(alone, &mut measured.alone), (served, &mut measured.served)] {
                let each = task.test.iter().zip(&driven);
                into.push(each.map(|(event, driven)| Errors::of(event, shape.horizon, driven)).collect());
            }
        }
        measured
    }
}
