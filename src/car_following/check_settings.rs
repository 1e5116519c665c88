//! What an event may look like.

use serde::{Deserialize, Serialize};

/// Thresholds of the physics checks. Defaults are for noisy recordings: they keep what a sensor may have seen and
/// refuse what no vehicle did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CheckSettings {
    /// Shortest step, s.
    pub min_dt_s: f64,
    /// Longest step, s.
    pub max_dt_s: f64,
    /// A step between two times may differ from the mean one by this share of it.
    pub max_time_jitter: f64,
    /// Speeds from −this to 0 are noise around standstill and become 0, m/s.
    pub speed_noise_mps: f64,
    /// Highest speed, m/s.
    pub max_speed_mps: f64,
    /// Largest net spacing, m.
    pub max_spacing_m: f64,
    /// Strongest acceleration from one step to the next, m/s².
    pub max_accel_mps2: f64,
    /// Strongest braking from one step to the next, m/s², positive.
    pub max_braking_mps2: f64,
    /// A given relative speed may differ from leader − follower by this, m/s.
    pub max_rel_speed_error_mps: f64,
    /// From one step to the next, spacing may differ from integrated relative speed by this, m.
    pub max_spacing_jump_m: f64,
    /// Over a whole event, spacing may differ from integrated relative speed by this, m, …
    pub max_spacing_drift_m: f64,
    /// … and by this for each second of it, m/s.
    pub max_spacing_drift_mps: f64,
}

impl Default for CheckSettings {
    fn default() -> Self {
        Self {
            min_dt_s: 0.01,
            max_dt_s: 1.0,
            max_time_jitter: 0.2,
            speed_noise_mps: 0.1,
            max_speed_mps: 70.0,
            max_spacing_m: 500.0,
            max_accel_mps2: 12.0,
            max_braking_mps2: 12.0,
            max_rel_speed_error_mps: 0.5,
            max_spacing_jump_m: 1.5,
            max_spacing_drift_m: 3.0,
            max_spacing_drift_mps: 0.3,
        }
    }
}

/// A threshold that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} = {value} is not within {low} to {high}")]
pub struct CheckSettingsError {
    name: &'static str,
    value: f64,
    low: f64,
    high: f64,
}

impl CheckSettings {
    /// Checks that every threshold is a number that makes sense.
    ///
    /// # Errors
    /// Names the first that does not.
    pub fn checked(self) -> Result<Self, CheckSettingsError> {
        // The upper bounds are what f32 arrays and the sums over them hold comfortably.
        for (name, value, low, high) in [
            ("max_dt_s", self.max_dt_s, 0.001, 10.0),
            ("min_dt_s", self.min_dt_s, 0.001, self.max_dt_s),
            ("max_time_jitter", self.max_time_jitter, 0.0, 1.0),
            ("speed_noise_mps", self.speed_noise_mps, 0.0, 1e3),
            ("max_speed_mps", self.max_speed_mps, 0.0, 1e4),
            ("max_spacing_m", self.max_spacing_m, 0.0, 1e6),
            ("max_accel_mps2", self.max_accel_mps2, 0.0, 1e9),
            ("max_braking_mps2", self.max_braking_mps2, 0.0, 1e9),
            ("max_rel_speed_error_mps", self.max_rel_speed_error_mps, 0.0, 1e9),
            ("max_spacing_jump_m", self.max_spacing_jump_m, 0.0, 1e9),
            ("max_spacing_drift_m", self.max_spacing_drift_m, 0.0, 1e9),
            ("max_spacing_drift_mps", self.max_spacing_drift_mps, 0.0, 1e9),
        ] {
            if !(low..=high).contains(&value) {
                return Err(CheckSettingsError { name, value, low, high });
            }
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_usable_and_nonsense_is_named() {
        assert!(CheckSettings::default().checked().is_ok());
        let nonsense = CheckSettings { max_speed_mps: f64::NAN, ..CheckSettings::default() };
        assert_eq!(nonsense.checked().unwrap_err().name, "max_speed_mps");
        assert!(serde_json::from_str::<CheckSettings>(r#"{"max_speed": 3}"#).is_err());
    }
}
