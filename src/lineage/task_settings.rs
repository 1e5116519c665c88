//! Which settings a single task may override, and what the arithmetic takes from the result.

use serde_json::Value;

use super::{ModelSettings, SettingsError, Strength};
use crate::consolidation::{ImportanceOptions, Method};
use crate::driver::DriverShape;
use crate::training::LearnSettings;

/// What a line of versions shares: another value would make its weights, anchors or test events incomparable.
const OF_THE_LINE: [&str; 14] = [
    "hidden",
    "horizon",
    "memory",
    "features",
    "dt_s",
    "accel_limit_mps2",
    "estimator",
    "output",
    "mas_output",
    "accumulation",
    "split_seed",
    "schedule",
    "regimes",
    "retention",
];

/// Of these, what is about events that come and versions that go: no version depends on it.
const OF_THE_MODEL: [&str; 3] = ["schedule", "regimes", "retention"];

impl ModelSettings {
    /// The model's settings with a task's overrides.
    ///
    /// # Errors
    /// As [`Self::overridden`], and when a setting that the whole line shares would change.
    pub fn for_task(&self, overrides: &Value) -> Result<Self, SettingsError> {
        self.overridden_but(&OF_THE_LINE, overrides)
    }

    /// The settings of a fork of a model with these, with its overrides: it goes on with the same line.
    ///
    /// # Errors
    /// As [`Self::overridden`], and when a setting that the whole line shares would change.
    pub fn for_fork(&self, overrides: &Value) -> Result<Self, SettingsError> {
        let of_the_line: Vec<_> = OF_THE_LINE.into_iter().filter(|name| !OF_THE_MODEL.contains(name)).collect();
        self.overridden_but(&of_the_line, overrides)
    }

    fn overridden_but(&self, fixed: &[&'static str], overrides: &Value) -> Result<Self, SettingsError> {
        let settings = self.overridden(overrides)?;
        let plain = |settings: &Self| serde_json::to_value(settings).expect("settings are plain data");
        let (old, new) = (plain(self), plain(&settings));
        match fixed.iter().find(|&&name| old[name] != new[name]) {
            Some(&name) => Err(SettingsError {
                name: name.to_owned(),
                code: "invalid_setting",
                detail: format!("all versions of a model share it; this model has {}", old[name]),
            }),
            None => Ok(settings),
        }
    }

    /// The shape of the driver these settings describe.
    #[must_use]
    pub fn shape(&self) -> DriverShape {
        DriverShape {
            hidden: self.hidden as usize,
            horizon: self.horizon as usize,
            dt_s: self.dt_s as f32,
            accel_limit_mps2: self.accel_limit_mps2 as f32,
            memory: self.memory,
            features: self.features,
        }
    }

    /// How importance is computed.
    #[must_use]
    pub fn importance(&self) -> ImportanceOptions {
        ImportanceOptions {
            estimator: self.estimator,
            output: self.output,
            mas_output: self.mas_output,
            draws: self.estimator_draws,
        }
    }

    /// Whether a task of this method that continues a version has to find its strength.
    #[must_use]
    pub fn searches_strength(&self, method: Method) -> bool {
        method.consolidates() && matches!(self.strength, Some(Strength::Searched(_)))
    }

    /// The settings of the arithmetic; a strength that has to be found is the method's own until then.
    #[must_use]
    pub fn learning(&self) -> LearnSettings {
        LearnSettings {
            shape: self.shape(),
            epochs: self.epochs,
            minibatch: self.minibatch as usize,
            learning_rate: self.learning_rate as f32,
            learning_rate_schedule: self.learning_rate_schedule,
            random_start: self.random_start,
            clip_norm: self.clip_norm as f32,
            collision_penalty: self.collision_penalty as f32,
            backward_penalty: self.backward_penalty as f32,
            collision_margin_m: self.collision_margin_m as f32,
            strength: self.strength.and_then(Strength::fixed),
            lambda: self.lambda,
            importance: self.importance(),
            accumulation: self.accumulation,
            online_decay: self.online_decay,
            penalty_step: self.penalty_step,
            replay_share: self.replay_share,
            si_damping: self.si_damping,
            seed: self.seed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_task_may_train_longer_but_not_with_another_network() {
        let model = ModelSettings::default();
        assert_eq!(model.for_task(&json!({"epochs": 9, "hidden": 128})).unwrap().epochs, 9);
        assert_eq!(model.for_task(&json!({"hidden": 64})).unwrap_err().name, "hidden");
        assert_eq!(model.for_task(&Value::Null).unwrap(), model);
    }

    #[test]
    fn a_fork_may_be_scheduled_otherwise_but_not_split_otherwise() {
        let model = ModelSettings { hidden: 16, ..ModelSettings::default() };
        let fork = model.for_fork(&json!({"epochs": 9, "schedule": "manual", "hidden": 16})).unwrap();
        assert_eq!((fork.epochs, fork.hidden), (9, 16));
        assert_eq!(model.for_fork(&json!({"split_seed": 7})).unwrap_err().name, "split_seed");
        assert_eq!(model.for_fork(&Value::Null).unwrap(), model);
    }

    #[test]
    fn only_what_consolidates_searches_and_only_when_asked() {
        let searched = ModelSettings::default().for_task(&json!({"strength": "auto"})).unwrap();
        assert!(searched.searches_strength(Method::Ewc) && searched.searches_strength(Method::ReplayMas));
        assert!(!searched.searches_strength(Method::Naive) && !searched.searches_strength(Method::Replay));
        assert!(!ModelSettings::default().searches_strength(Method::Ewc));
        assert_eq!(searched.learning().strength, None);
    }
}
