//! One stage: from a parent's weights and the training events of one regime to new weights and what to remember.

use rayon::ThreadPool;
use serde::Serialize;

use crate::car_following::Event;
use crate::consolidation::{Accumulation, MasOutput, Method, PenaltyStep};
use crate::driver::{DriverShape, Scaling};

/// What is kept of one regime: its diagonal importance and the weights it is anchored at, one value per weight each.
#[derive(Debug, Clone, PartialEq)]
pub struct RegimeMemory {
    /// The regime's name.
    pub regime: String,
    /// Diagonal importance, mean per supervised step.
    pub importance: Vec<f32>,
    /// The weights at the end of the last stage that learned the regime.
    pub anchor: Vec<f32>,
    /// Supervised steps behind the importance.
    pub samples: u64,
}

/// Settings of the arithmetic, from the model's settings.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnSettings {
    /// Hidden units, horizon, step, acceleration limit.
    pub shape: DriverShape,
    /// Passes.
    pub epochs: u32,
    /// Events per update.
    pub minibatch: usize,
    /// Adam's.
    pub learning_rate: f32,
    /// Global norm.
    pub clip_norm: f32,
    /// Weight of mean relu(−s).
    pub collision_penalty: f32,
    /// Weight of mean relu(−v).
    pub backward_penalty: f32,
    /// Null takes the method's default.
    pub strength: Option<f64>,
    /// Wins over strength.
    pub lambda: Option<f64>,
    /// Which gradient MAS takes.
    pub mas_output: MasOutput,
    /// Null takes the method's default.
    pub accumulation: Option<Accumulation>,
    /// How the penalty is applied.
    pub penalty_step: PenaltyStep,
    /// Of every random choice.
    pub seed: u64,
}

/// Everything a stage learns from.
pub struct StageInput<'a> {
    /// The method.
    pub method: Method,
    /// The arithmetic's settings.
    pub settings: LearnSettings,
    /// Position on the line, from 1.
    pub stage: u32,
    /// The regime learned.
    pub regime: &'a str,
    /// The parent's weights; none at stage 1 (and unused by `joint`, which starts afresh).
    pub parent_weights: Option<&'a [f32]>,
    /// The line's scaling; none at stage 1, where it is estimated from `train`.
    pub scaling: Option<Scaling>,
    /// What earlier stages keep, in the order the regimes were first learned.
    pub memory: &'a [RegimeMemory],
    /// Training events at the model's step, in any order: they are put into order of content.
    pub train: &'a [Event],
}

/// How far a stage is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Progress {
    /// From 1.
    pub epoch: u32,
    /// Updates done.
    pub update: u64,
    /// Updates in all.
    pub updates: u64,
    /// Loss of the last minibatch, without penalty.
    pub loss: f64,
    /// Consolidation penalty at the weights before the last update.
    pub penalty: f64,
    /// Training events per second since the stage (re)started.
    pub events_per_s: f64,
}

/// What a stage tells while it runs, on the thread that called it.
pub trait Observer {
    /// After every update. `false` stops the stage with [`LearnError::Stopped`].
    fn updated(&mut self, progress: &Progress) -> bool;
    /// Asked after every update: whether to be given a checkpoint now.
    fn wants_checkpoint(&mut self) -> bool;
    /// The checkpoint: opaque bytes for `resume`. Also given when the stage is stopped.
    fn checkpoint(&mut self, progress: &Progress, state: Vec<u8>);
}

/// The outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct Learned {
    /// One flat vector.
    pub weights: Vec<f32>,
    /// The line's scaling.
    pub scaling: Scaling,
    /// What to keep of this regime, merged with what was kept of it before; none for `naive` and `joint`.
    pub memory: Option<RegimeMemory>,
    /// The strength used; none where unused.
    pub strength: Option<f64>,
    /// The number in the formula; none where unused (also at stage 1).
    pub lambda: Option<f64>,
    /// Name of the arithmetic.
    pub kernel: String,
    /// Time inside updates, s.
    pub update_s: f64,
}

/// Why a stage gave no weights.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LearnError {
    /// No event is long enough to drive.
    #[error("no training event is longer than the horizon")]
    NoTrainingEvents,
    /// The loss or a weight stopped being finite.
    #[error("training diverged at update {update}: {what} is not finite")]
    Diverged {
        /// The update.
        update: u64,
        /// What was not finite.
        what: &'static str,
    },
    /// The observer said stop; a checkpoint was given first.
    #[error("stopped")]
    Stopped,
    /// The checkpoint does not belong to this input.
    #[error("the checkpoint does not fit: {0}")]
    Checkpoint(String),
}

/// Learns one stage. The same input gives the same bits whatever the threads of `workers` and wherever it was resumed.
///
/// # Errors
/// See [`LearnError`].
pub fn learn_stage(
    _input: &StageInput<'_>,
    _resume: Option<&[u8]>,
    _workers: &ThreadPool,
    _observer: &mut dyn Observer,
) -> Result<Learned, LearnError> {
    Err(LearnError::NoTrainingEvents)
}
