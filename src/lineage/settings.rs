//! A model's settings: the names of the wire, checked, resolved and stored with every version.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::regime::{RegimeRule, Schedule};
use super::{Preset, PromotionPolicy, Retention, Strength};
use crate::consolidation::{Accumulation, Estimator, MasOutput, Method, Output, PenaltyStep};
use crate::driver::{Features, Memory};
use crate::training::RateSchedule;

/// Everything a model can be told. Defaults are those of [`Preset::Best`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelSettings {
    /// Hidden units of the LSTM.
    pub hidden: u32,
    /// Steps in a window, at least 2.
    pub horizon: u32,
    /// Window or carried state.
    pub memory: Memory,
    /// What the network reads of a step.
    #[serde(default = "before::features")]
    pub features: Features,
    /// The model's step, s; events of another step are resampled.
    pub dt_s: f64,
    /// The network's acceleration lies within ± this, m/s².
    pub accel_limit_mps2: f64,
    /// Passes over the training events of a stage.
    pub epochs: u32,
    /// Events in one optimiser update.
    pub minibatch: u32,
    /// Of Adam, at its greatest.
    pub learning_rate: f64,
    /// How it changes along a stage.
    #[serde(default = "before::learning_rate_schedule")]
    pub learning_rate_schedule: RateSchedule,
    /// Updates begin each event at random, up to this share of its simulated steps later.
    #[serde(default)]
    pub random_start: f64,
    /// Global norm the gradient is clipped to.
    pub clip_norm: f64,
    /// Weight of mean relu(min(margin, recorded spacing) − spacing).
    pub collision_penalty: f64,
    /// Weight of mean relu(−speed).
    pub backward_penalty: f64,
    /// Below this and below the recorded spacing, a simulated spacing counts as a collision in the loss, m; 0 is the paper's.
    pub collision_margin_m: f64,
    /// Consolidation strength in the unit that carries over between data; null takes the method's default.
    pub strength: Option<Strength>,
    /// The formula's number; wins over `strength`.
    pub lambda: Option<f64>,
    /// How importance is estimated.
    pub estimator: Estimator,
    /// Backward passes per event of the sampled estimator.
    pub estimator_draws: u32,
    /// Over which output.
    pub output: Output,
    /// Which gradient MAS takes.
    pub mas_output: MasOutput,
    /// How the importance of several regimes adds up; null takes the method's default.
    pub accumulation: Option<Accumulation>,
    /// What is left of older regimes' importance with each newer one, for `online` accumulation.
    pub online_decay: f64,
    /// How the penalty is applied.
    pub penalty_step: PenaltyStep,
    /// Training events of each earlier regime that are replayed: those of least digest.
    pub replay_events: u32,
    /// Share of an update's events that are replayed.
    pub replay_share: f64,
    /// Damping ξ of synaptic intelligence, a squared change of weights.
    pub si_damping: f64,
    /// Of every random choice in training.
    pub seed: u64,
    /// Of the split into training, validation and test.
    pub split_seed: u64,
    /// Whether served accelerations are bounded by an envelope ([`crate::safety::Envelope`]).
    pub envelope: bool,
    /// When pending events become a task.
    pub schedule: Schedule,
    /// Which regime an event belongs to.
    pub regimes: RegimeRule,
    /// When a new version goes live by itself.
    pub promotion: PromotionPolicy,
    /// `gated`: no regime's error may exceed the live version's by more than this factor.
    pub promotion_error_ratio: f64,
    /// Most regimes a line may learn.
    pub max_regimes: u32,
    /// Most test events kept per regime.
    pub test_reservoir: u32,
    /// What is kept of events and versions.
    pub retention: Retention,
}

impl Default for ModelSettings {
    fn default() -> Self {
        Preset::Best.settings()
    }
}

/// What versions were made with before there was a choice.
mod before {
    use super::{Features, RateSchedule};

    pub(super) fn features() -> Features {
        Features::Raw
    }

    pub(super) fn learning_rate_schedule() -> RateSchedule {
        RateSchedule::Constant
    }
}

/// Why settings were refused: one setting and what is wrong with it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("setting {name}: {detail}")]
pub struct SettingsError {
    /// The setting; empty when the object as a whole is wrong.
    pub name: String,
    /// `invalid_setting`.
    pub code: &'static str,
    /// What would be right.
    pub detail: String,
}

impl ModelSettings {
    /// These settings with the members of `overrides` (a JSON object, or null for none) in place of their own. A member
    /// `preset` names where the settings that are not given come from instead.
    ///
    /// # Errors
    /// An unknown name, or a value of the wrong type or out of range.
    pub fn overridden(&self, overrides: &Value) -> Result<Self, SettingsError> {
        let members = match overrides {
            Value::Null => return Ok(self.clone()),
            Value::Object(members) => members,
            _ => return Err(SettingsError::invalid("", "an object is needed")),
        };
        let preset = members.get("preset").map(|name| serde_json::from_value::<Preset>(name.clone()));
        let preset = preset.transpose().map_err(|e| SettingsError::invalid("preset", &e.to_string()))?;
        let from = preset.map_or_else(|| self.clone(), Preset::settings);
        let Value::Object(mut resolved) = serde_json::to_value(from).expect("settings are plain data") else {
            unreachable!("settings are an object")
        };
        for (name, value) in members.iter().filter(|(name, _)| *name != "preset") {
            if !resolved.contains_key(name) {
                let known: Vec<_> = resolved.keys().map(String::as_str).collect();
                return Err(SettingsError::invalid(name, &format!("unknown; known are {}", known.join(", "))));
            }
            if value.is_array() {
                // Left to itself serde takes an array of a struct's fields in their order.
                return Err(SettingsError::invalid(name, "no setting is an array"));
            }
            let mut one = serde_json::to_value(Self::default()).expect("settings are plain data");
            one[name] = value.clone();
            // Alone in the defaults, so that the message can name the setting.
            serde_json::from_value::<Self>(one).map_err(|e| SettingsError::invalid(name, &e.to_string()))?;
            resolved.insert(name.clone(), value.clone());
        }
        let resolved: Self =
            serde_json::from_value(Value::Object(resolved)).map_err(|e| SettingsError::invalid("", &e.to_string()))?;
        resolved.check()?;
        Ok(resolved)
    }

    /// Checks ranges and availability.
    ///
    /// # Errors
    /// Names the first setting that cannot be used.
    pub fn check(&self) -> Result<(), SettingsError> {
        let whole = |name, value: u32, low: u32, high: u32| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(SettingsError::invalid(name, &format!("{value} is not within {low} to {high}")))
            }
        };
        let real = |name, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(SettingsError::invalid(name, &format!("{value} is not within {low} to {high}")))
            }
        };
        whole("hidden", self.hidden, 1, 1024)?;
        whole("horizon", self.horizon, 2, 100)?;
        real("dt_s", self.dt_s, 0.01, 1.0)?;
        real("accel_limit_mps2", self.accel_limit_mps2, 0.5, 12.0)?;
        whole("epochs", self.epochs, 1, 1000)?;
        whole("minibatch", self.minibatch, 1, 1024)?;
        real("learning_rate", self.learning_rate, 1e-8, 1.0)?;
        real("clip_norm", self.clip_norm, 1e-6, 1e9)?;
        real("collision_penalty", self.collision_penalty, 0.0, 1e9)?;
        real("backward_penalty", self.backward_penalty, 0.0, 1e9)?;
        real("collision_margin_m", self.collision_margin_m, 0.0, 100.0)?;
        real("strength", self.strength.and_then(Strength::fixed).unwrap_or(1.0), 0.0, 1e12)?;
        real("lambda", self.lambda.unwrap_or(1.0), 0.0, 1e30)?;
        whole("estimator_draws", self.estimator_draws, 1, 16)?;
        real("online_decay", self.online_decay, 0.0, 1.0)?;
        whole("replay_events", self.replay_events, 1, 100_000)?;
        real("replay_share", self.replay_share, 0.0, 0.95)?;
        real("si_damping", self.si_damping, 1e-9, 1e3)?;
        real("promotion_error_ratio", self.promotion_error_ratio, 1.0, 1e6)?;
        whole("max_regimes", self.max_regimes, 1, 4096)?;
        whole("test_reservoir", self.test_reservoir, 1, 100_000)?;
        whole("retention", self.retention.versions.unwrap_or(1), 1, u32::MAX)?;
        if let RegimeRule::Bands(bands) = &self.regimes
            && let Some(defect) = bands.defect()
        {
            return Err(SettingsError::invalid("regimes", &defect));
        }
        real("random_start", self.random_start, 0.0, 0.95)?;
        if self.features == Features::Motion && self.memory == Memory::Window {
            let detail = "motion needs memory carried; raw goes with window (preset paper has both)";
            return Err(SettingsError::invalid("features", detail));
        }
        if matches!(self.strength, Some(Strength::Searched(_))) && self.lambda.is_some() {
            let detail = "auto leaves nothing to search where lambda is given: take one of them and null for the other";
            return Err(SettingsError::invalid("strength", detail));
        }
        self.check_importance(None)
    }

    /// Checks that a model of this method can use them.
    ///
    /// # Errors
    /// Names the setting that the method has no use for with the others as they are.
    pub fn check_for(&self, method: Method) -> Result<(), SettingsError> {
        self.check_importance(Some(method))
    }

    fn check_importance(&self, method: Option<Method>) -> Result<(), SettingsError> {
        match self.importance().conflict(method) {
            Some((name, why)) => Err(SettingsError::invalid(name, &why)),
            None => Ok(()),
        }
    }
}

impl SettingsError {
    fn invalid(name: &str, detail: &str) -> Self {
        Self { name: name.to_owned(), code: "invalid_setting", detail: detail.to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lineage::Auto;
    use serde_json::json;

    #[test]
    fn overrides_replace_and_the_rest_stays() {
        let settings = ModelSettings::default().overridden(&json!({"hidden": 64, "schedule": "manual"})).unwrap();
        assert_eq!(settings.hidden, 64);
        assert_eq!(settings.epochs, 5);
        assert!(!settings.schedule.is_due(u64::MAX, 1e9));
    }

    #[test]
    fn a_preset_is_where_the_other_settings_come_from() {
        let paper = ModelSettings::default().overridden(&json!({"hidden": 64, "preset": "paper"})).unwrap();
        assert_eq!(paper, ModelSettings { hidden: 64, ..Preset::Paper.settings() });
        assert_eq!((paper.minibatch, paper.learning_rate, paper.random_start), (32, 0.001, 0.0));
        let back = paper.overridden(&json!({"preset": "best"})).unwrap();
        assert_eq!(back, ModelSettings::default());
    }

    #[test]
    fn what_was_stored_before_there_was_a_choice_is_read_as_it_was_meant() {
        let mut stored = serde_json::to_value(Preset::Paper.settings()).unwrap();
        for name in ["features", "learning_rate_schedule", "random_start"] {
            stored.as_object_mut().unwrap().remove(name).unwrap();
        }
        assert_eq!(serde_json::from_value::<ModelSettings>(stored).unwrap(), Preset::Paper.settings());
    }

    #[test]
    fn a_strength_is_a_number_a_search_or_the_methods_own() {
        let strength = |value: Value| ModelSettings::default().overridden(&json!({ "strength": value }));
        assert_eq!(strength(json!("auto")).unwrap().strength, Some(Strength::Searched(Auto::Auto)));
        assert_eq!(strength(json!(2)).unwrap().strength, Some(Strength::Fixed(2.0)));
        assert_eq!(strength(Value::Null).unwrap().strength, None);
        for value in [json!("automatic"), json!(-1.0), json!(true), json!({})] {
            assert_eq!(strength(value).unwrap_err().name, "strength");
        }
        let searched = strength(json!("auto")).unwrap();
        assert_eq!(serde_json::to_value(&searched).unwrap()["strength"], json!("auto"));
        assert_eq!(searched.overridden(&json!({"lambda": 5.0})).unwrap_err().name, "strength");
        assert_eq!(searched.overridden(&json!({"lambda": 5.0, "strength": null})).unwrap().lambda, Some(5.0));
    }

    #[test]
    fn a_bad_setting_is_named() {
        for (overrides, name) in [
            (json!({"hiden": 64}), "hiden"),
            (json!({"hidden": "many"}), "hidden"),
            (json!({"hidden": 0}), "hidden"),
            (json!({"horizon": 1}), "horizon"),
            (json!({"learning_rate": -1.0}), "learning_rate"),
            (json!({"regimes": {"by": "mean_speed_mps", "edges": [2.0, 1.0]}}), "regimes"),
            (json!({"regimes": ["mean_speed_mps", [1.0, 2.0]]}), "regimes"),
            (json!({"schedule": [5, 10]}), "schedule"),
            (json!({"memory": "window"}), "features"),
            (json!({"preset": "papers"}), "preset"),
            (json!({"retention": {"versions": 0}}), "retention"),
            (json!({"retention": {"events_days": 3}}), "retention"),
            (json!([1]), ""),
        ] {
            assert_eq!(ModelSettings::default().overridden(&overrides).unwrap_err().name, name, "{overrides}");
        }
    }

    #[test]
    fn options_that_exclude_each_other_are_named() {
        let settings = |overrides: Value| ModelSettings::default().overridden(&overrides);
        let closed = settings(json!({"estimator": "empirical", "output": "closed_loop"})).unwrap_err();
        assert_eq!((closed.name.as_str(), closed.code), ("estimator", "invalid_setting"));
        let empirical = settings(json!({"estimator": "empirical"})).unwrap();
        assert_eq!(empirical.check_for(Method::Ewc), Ok(()));
        assert_eq!(empirical.check_for(Method::Mas).unwrap_err().name, "estimator");
        let few = settings(json!({"estimator": "sampled", "estimator_draws": 2})).unwrap();
        assert_eq!(few.check_for(Method::Mas).unwrap_err().name, "estimator_draws");
    }

    #[test]
    fn settings_survive_their_json() {
        let settings = ModelSettings::default();
        let json = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<ModelSettings>(&json).unwrap(), settings);
    }
}
