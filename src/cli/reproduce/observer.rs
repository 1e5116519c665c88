//! What a stage tells on its way: progress, checkpoints, and errors for the figure of the stability gap.

use std::time::{Duration, Instant};

use rayon::ThreadPool;

use super::plan::Plan;
use super::progress::Progress;
use super::state::{HalfStage, State, TracePoint};
use crate::car_following::Event;
use crate::driver::{DriverShape, Scaling};
use crate::evaluation::evaluate;
use crate::training::{self, Interim, Observer};

/// Most test events of a task that are driven on the way.
const TRACED_EVENTS: usize = 64;
/// Updates at the start of a stage after which the errors are measured finely: the gap opens there.
const FINE_UPDATES: u64 = 20;
/// Updates from one measurement to the next, at first.
const TRACED_EVERY: u64 = 2;
/// Measurements over the whole stage, about.
const TRACED_POINTS: u64 = 25;

/// Errors on the way through a stage.
pub(super) struct Trace<'a> {
    tasks: Vec<Vec<Event>>,
    shape: DriverShape,
    workers: &'a ThreadPool,
    points: Vec<TracePoint>,
}

impl<'a> Trace<'a> {
    /// On some test events of each task, spread evenly over them.
    pub(super) fn new(plan: &Plan, shape: DriverShape, workers: &'a ThreadPool) -> Self {
        let some = |events: &[Event]| {
            let kept = events.len().min(TRACED_EVENTS);
            (0..kept).map(|i| events[i * events.len() / kept].clone()).collect()
        };
        Self { tasks: plan.tasks.iter().map(|task| some(&task.test)).collect(), shape, workers, points: Vec::new() }
    }

    /// What was measured before the stage was interrupted.
    pub(super) fn resume(&mut self, points: Vec<TracePoint>) {
        self.points = points;
    }

    pub(super) fn points(self) -> Vec<TracePoint> {
        self.points
    }

    fn measure(&mut self, update: u64, scaling: &Scaling, weights: &[f32]) {
        let spacing_mse = self.tasks.iter().map(|events| {
            let errors = evaluate(self.shape, scaling, weights, events, self.workers);
            errors.spacing_sq / errors.steps.max(1) as f64
        });
        self.points.push(TracePoint { update, spacing_mse: spacing_mse.collect() });
    }
}

/// Lives as long as a stage.
pub(super) struct StageObserver<'a, 'w> {
    state: &'a State,
    key: &'a str,
    progress: &'a Progress,
    checkpoint_every: Duration,
    last_checkpoint: Instant,
    trace: Option<&'a mut Trace<'w>>,
    failed: Option<anyhow::Error>,
}

impl<'a, 'w> StageObserver<'a, 'w> {
    pub(super) fn new(
        state: &'a State,
        key: &'a str,
        progress: &'a Progress,
        checkpoint_every: Duration,
        trace: Option<&'a mut Trace<'w>>,
    ) -> Self {
        Self { state, key, progress, checkpoint_every, last_checkpoint: Instant::now(), trace, failed: None }
    }

    /// Whether everything could be kept.
    pub(super) fn end(self) -> anyhow::Result<()> {
        self.failed.map_or(Ok(()), Err)
    }
}

impl Observer for StageObserver<'_, '_> {
    fn weights(&mut self, progress: &training::Progress, scaling: &Scaling, weights: &[f32]) {
        let Some(trace) = &mut self.trace else { return };
        let fine = progress.update <= FINE_UPDATES;
        let every = if fine { TRACED_EVERY } else { progress.updates.div_ceil(TRACED_POINTS).max(TRACED_EVERY) };
        if progress.update == 1 || progress.update.is_multiple_of(every) || progress.update == progress.updates {
            trace.measure(progress.update, scaling, weights);
        }
    }

    fn updated(&mut self, progress: &training::Progress) -> bool {
        self.progress.updated(progress);
        self.failed.is_none()
    }

    fn evaluated(&mut self, _: &Interim) {}

    fn wants_stop(&mut self) -> bool {
        false
    }

    fn wants_checkpoint(&mut self) -> bool {
        self.last_checkpoint.elapsed() >= self.checkpoint_every
    }

    fn checkpoint(&mut self, _: &training::Progress, checkpoint: Vec<u8>) {
        let trace = self.trace.as_ref().map_or_else(Vec::new, |trace| trace.points.clone());
        // A disk that is full stops the run: it could not end well.
        self.failed = self.state.keep_half(self.key, &HalfStage { checkpoint, trace }).err();
        self.last_checkpoint = Instant::now();
    }
}
