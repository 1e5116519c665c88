//! The arithmetic as the scheduler sees it, so that a test can put something quick in its place.

use rayon::ThreadPool;

use crate::car_following::Event;
use crate::driver::{DriverShape, Scaling};
use crate::evaluation::{self, Errors, ServedErrors};
use crate::training::{self, LearnError, Learned, Observer, StageInput};

/// Learns stages and measures what came of it. Called on blocking threads.
pub trait Learner: Send + Sync + 'static {
    /// As [`training::learn_stage`].
    ///
    /// # Errors
    /// See [`LearnError`].
    fn learn(
        &self,
        input: &StageInput<'_>,
        resume: Option<&[u8]>,
        workers: &ThreadPool,
        observer: &mut dyn Observer,
    ) -> Result<Learned, LearnError>;

    /// As [`evaluation::evaluate`].
    fn evaluate(
        &self,
        shape: DriverShape,
        scaling: &Scaling,
        weights: &[f32],
        events: &[Event],
        workers: &ThreadPool,
    ) -> Errors;

    /// As [`evaluation::evaluate_served`].
    fn evaluate_served(
        &self,
        shape: DriverShape,
        scaling: &Scaling,
        weights: &[f32],
        events: &[Event],
        workers: &ThreadPool,
    ) -> ServedErrors;
}

/// The real one.
#[derive(Debug, Clone, Copy, Default)]
pub struct Training;

impl Learner for Training {
    fn learn(
        &self,
        input: &StageInput<'_>,
        resume: Option<&[u8]>,
        workers: &ThreadPool,
        observer: &mut dyn Observer,
    ) -> Result<Learned, LearnError> {
        training::learn_stage(input, resume, workers, observer)
    }

    fn evaluate(
        &self,
        shape: DriverShape,
        scaling: &Scaling,
        weights: &[f32],
        events: &[Event],
        workers: &ThreadPool,
    ) -> Errors {
        evaluation::evaluate(shape, scaling, weights, events, workers)
    }

    fn evaluate_served(
        &self,
        shape: DriverShape,
        scaling: &Scaling,
        weights: &[f32],
        events: &[Event],
        workers: &ThreadPool,
    ) -> ServedErrors {
        evaluation::evaluate_served(shape, scaling, weights, events, workers)
    }
}
