//! What a stage learns from.

use super::rate::RateSchedule;
use super::replay::ReplayedRegime;
use crate::car_following::Event;
use crate::consolidation::{Accumulation, ImportanceOptions, Method, PenaltyStep, RegimeMemory};
use crate::driver::{DriverShape, Scaling};

/// Settings of the arithmetic, from the model's settings.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnSettings {
    /// Hidden units, horizon, step, acceleration limit.
    pub shape: DriverShape,
    /// Passes.
    pub epochs: u32,
    /// Events per update.
    pub minibatch: usize,
    /// Adam's, at its greatest.
    pub learning_rate: f32,
    /// How it changes along the stage.
    pub learning_rate_schedule: RateSchedule,
    /// An update begins each event at random, up to this share of the steps it could simulate later; 0 at its first step.
    pub random_start: f64,
    /// Global norm.
    pub clip_norm: f32,
    /// Weight of mean relu(min(margin, s*) − s).
    pub collision_penalty: f32,
    /// Weight of mean relu(−v).
    pub backward_penalty: f32,
    /// The margin in the collision penalty, m.
    pub collision_margin_m: f32,
    /// Null takes the method's default.
    pub strength: Option<f64>,
    /// Wins over strength.
    pub lambda: Option<f64>,
    /// How importance is computed.
    pub importance: ImportanceOptions,
    /// Null takes the method's default.
    pub accumulation: Option<Accumulation>,
    /// γ of `online` accumulation.
    pub online_decay: f64,
    /// How the penalty is applied.
    pub penalty_step: PenaltyStep,
    /// Share of an update's events that are replayed, where the method replays and there are some.
    pub replay_share: f64,
    /// ξ of synaptic intelligence.
    pub si_damping: f64,
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
    /// Training events of regimes learned earlier, for methods that replay.
    pub replay: &'a [ReplayedRegime],
    /// Training events at the model's step, in any order: they are put into order of content.
    pub train: &'a [Event],
    /// Events to drive after every epoch, at the model's step. They tell how far learning is, and change nothing.
    pub validation: &'a [Event],
}
