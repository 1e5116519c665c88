//! Named settings: the best that was measured, and the paper's.

use serde::{Deserialize, Serialize};

use super::ModelSettings;
use super::regime::{AutomaticSchedule, RegimeRule, Schedule};
use super::{PromotionPolicy, Retention};
use crate::consolidation::{Estimator, MasOutput, Output, PenaltyStep};
use crate::driver::{Features, Memory};
use crate::training::RateSchedule;

/// Settings by name; `preset` beside other settings is where those that are not given come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// What drove best and forgot least when measured (`docs/measurements.md`): one state carried along the event, features
    /// of motion, updates of 8 events begun at random, a learning rate that rises and falls, and a dearer way back.
    #[default]
    Best,
    /// The paper's: every window encoded afresh, its four inputs, updates of 32 events, a constant learning rate.
    Paper,
}

impl Preset {
    /// Its settings.
    #[must_use]
    pub fn settings(self) -> ModelSettings {
        match self {
            Self::Paper => paper(),
            Self::Best => ModelSettings {
                memory: Memory::Carried,
                features: Features::Motion,
                minibatch: 8,
                learning_rate: 0.004,
                learning_rate_schedule: RateSchedule::Cosine,
                random_start: 0.5,
                // Standing still is worth little in the loss, and a network that asks a standing car to back up has to be held.
                backward_penalty: 10_000.0,
                estimator: Estimator::Sampled,
                ..paper()
            },
        }
    }
}

fn paper() -> ModelSettings {
    ModelSettings {
        hidden: 128,
        horizon: 10,
        memory: Memory::Window,
        features: Features::Raw,
        dt_s: 0.1,
        accel_limit_mps2: 4.0,
        epochs: 5,
        minibatch: 32,
        learning_rate: 0.001,
        learning_rate_schedule: RateSchedule::Constant,
        random_start: 0.0,
        clip_norm: 1.0,
        collision_penalty: 1000.0,
        backward_penalty: 1000.0,
        collision_margin_m: 4.0,
        strength: None,
        lambda: None,
        estimator: Estimator::Exact,
        estimator_draws: 3,
        output: Output::OpenLoop,
        mas_output: MasOutput::Jacobian,
        accumulation: None,
        online_decay: 0.95,
        penalty_step: PenaltyStep::Proximal,
        replay_events: 500,
        replay_share: 0.5,
        si_damping: 0.001,
        seed: 42,
        split_seed: 0,
        envelope: true,
        schedule: Schedule::Automatic(AutomaticSchedule { min_events: 500, max_wait_s: 3600 }),
        regimes: RegimeRule::LABEL,
        promotion: PromotionPolicy::Gated,
        promotion_error_ratio: 1.1,
        max_regimes: 64,
        test_reservoir: 500,
        retention: Retention::default(),
    }
}
