//! What an upload says about its events beside the body: the query of the call.

use serde::{Deserialize, Serialize};

use crate::car_following::{Conversion, SpacingDefinition};
use crate::formats::Preset;
use crate::lineage::RegimeName;

/// What the recorded spacing is measured between.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpacingKind {
    /// Bumper to bumper.
    #[default]
    Net,
    /// Front to front: needs `leader_length_m`.
    Front,
    /// Centre to centre: needs both lengths.
    Centre,
}

/// Options of an upload.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UploadOptions {
    /// Names of the columns of a tabular body.
    pub preset: Preset,
    /// Step of events that do not declare one, s.
    pub dt_s: Option<f64>,
    /// What spacing is measured between.
    pub spacing: SpacingKind,
    /// Leader's length, m.
    pub leader_length_m: Option<f64>,
    /// Follower's length, m.
    pub follower_length_m: Option<f64>,
    /// Source of events that name none.
    pub source: Option<String>,
    /// The upload's regime.
    pub regime: Option<RegimeName>,
}

/// An option that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: {detail}")]
pub struct OptionError {
    /// Its name in the query.
    pub name: &'static str,
    /// `missing_option` or `invalid_option`.
    pub code: &'static str,
    /// What would be right.
    pub detail: String,
}

/// Longest vehicle believed, m.
const MAX_LENGTH_M: f64 = 50.0;
const MAX_SOURCE_CHARS: usize = 512;

impl UploadOptions {
    /// How events are to be converted.
    ///
    /// # Errors
    /// When a length that the spacing definition needs is missing, or an option is out of range.
    pub fn conversion(&self) -> Result<Conversion, OptionError> {
        if self.dt_s.is_some_and(|dt_s| !(dt_s > 0.0 && dt_s.is_finite())) {
            return Err(invalid("dt_s", "a step above 0 s is needed".to_owned()));
        }
        if self.source.as_ref().is_some_and(|source| !(1..=MAX_SOURCE_CHARS).contains(&source.chars().count())) {
            return Err(invalid("source", format!("1 to {MAX_SOURCE_CHARS} characters are needed")));
        }
        let leader = length("leader_length_m", self.leader_length_m)?;
        let follower = length("follower_length_m", self.follower_length_m)?;
        let spacing = match self.spacing {
            SpacingKind::Net => SpacingDefinition::Net,
            SpacingKind::Front => SpacingDefinition::Front { leader_length_m: needed("leader_length_m", leader)? },
            SpacingKind::Centre => SpacingDefinition::Centre {
                leader_length_m: needed("leader_length_m", leader)?,
                follower_length_m: needed("follower_length_m", follower)?,
            },
        };
        Ok(Conversion { dt_s: self.dt_s, spacing })
    }
}

fn length(name: &'static str, length_m: Option<f64>) -> Result<Option<f64>, OptionError> {
    match length_m {
        Some(length_m) if !(length_m > 0.0 && length_m <= MAX_LENGTH_M) => {
            Err(invalid(name, format!("{length_m} m is not within 0 to {MAX_LENGTH_M} m")))
        }
        length_m => Ok(length_m),
    }
}

fn needed(name: &'static str, length_m: Option<f64>) -> Result<f64, OptionError> {
    length_m.ok_or_else(|| OptionError {
        name,
        code: "missing_option",
        detail: "this spacing needs it, to get the net one".to_owned(),
    })
}

fn invalid(name: &'static str, detail: String) -> OptionError {
    OptionError { name, code: "invalid_option", detail }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spacing_needs_the_lengths_of_its_definition() {
        let options = |spacing, leader_length_m, follower_length_m| UploadOptions {
            spacing,
            leader_length_m,
            follower_length_m,
            ..UploadOptions::default()
        };
        let missing = |options: UploadOptions| options.conversion().unwrap_err().name;
        assert_eq!(options(SpacingKind::Net, None, None).conversion().unwrap().spacing.excess_m(), 0.0);
        assert_eq!(options(SpacingKind::Front, Some(4.0), None).conversion().unwrap().spacing.excess_m(), 4.0);
        assert_eq!(options(SpacingKind::Centre, Some(4.0), Some(5.0)).conversion().unwrap().spacing.excess_m(), 4.5);
        assert_eq!(missing(options(SpacingKind::Front, None, Some(4.0))), "leader_length_m");
        assert_eq!(missing(options(SpacingKind::Centre, Some(4.0), None)), "follower_length_m");
        assert_eq!(missing(options(SpacingKind::Net, Some(-4.0), None)), "leader_length_m");
    }
}
