//! What an upload says about its events beside the body: the query of the call.

use serde::{Deserialize, Serialize};

use crate::car_following::{Conversion, ExtractionSettings, ExtractionSettingsError, SpacingDefinition};
use crate::formats::{Format, Preset};
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
    /// Of a whole road: shortest event, s, instead of the server's setting.
    pub min_duration_s: Option<f64>,
    /// Longest event, s.
    pub max_duration_s: Option<f64>,
    /// Least net spacing, m.
    pub min_spacing_m: Option<f64>,
    /// Largest net spacing, m.
    pub max_spacing_m: Option<f64>,
}

/// An option that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: {detail}")]
pub struct OptionError {
    /// Its name in the query.
    pub name: &'static str,
    /// `missing_option`, `invalid_option` or `option_not_applicable`.
    pub code: &'static str,
    /// What would be right.
    pub detail: String,
}

/// Step of `FollowNet`'s events, s.
const FOLLOWNET_DT_S: f64 = 0.1;
/// Longest vehicle believed, m.
const MAX_LENGTH_M: f64 = 50.0;
const MAX_SOURCE_CHARS: usize = 512;

impl UploadOptions {
    /// How events of a body of `format` are to be converted.
    ///
    /// # Errors
    /// When a length that the spacing definition needs is missing, or an option is out of range.
    pub fn conversion(&self, format: Format) -> Result<Conversion, OptionError> {
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
        // Arrays are FollowNet's, whose step is this one, and have no room for another.
        let dt_s = self.dt_s.or((format == Format::Npy).then_some(FOLLOWNET_DT_S));
        Ok(Conversion { dt_s, spacing })
    }

    /// By which criteria events are extracted, where the body is a recording of a whole road.
    ///
    /// # Errors
    /// When a criterion is out of range, or an option says what such a body, or any other, says itself or does not need.
    pub fn extraction(&self, format: Format, settings: &ExtractionSettings) -> Result<ExtractionSettings, OptionError> {
        let of_road = self.preset.is_of_road(format);
        let (needless, why) = if of_road {
            let others = [
                ("dt_s", self.dt_s.is_some()),
                ("spacing", self.spacing != SpacingKind::Net),
                ("leader_length_m", self.leader_length_m.is_some()),
                ("follower_length_m", self.follower_length_m.is_some()),
            ];
            (others, "a recording of a whole road says its step, and gives net spacings")
        } else {
            let others = [
                ("min_duration_s", self.min_duration_s.is_some()),
                ("max_duration_s", self.max_duration_s.is_some()),
                ("min_spacing_m", self.min_spacing_m.is_some()),
                ("max_spacing_m", self.max_spacing_m.is_some()),
            ];
            (others, "events are extracted out of recordings of a whole road alone: preset ngsim or fcd, and XML")
        };
        if let Some((name, _)) = needless.into_iter().find(|(_, given)| *given) {
            return Err(OptionError { name, code: "option_not_applicable", detail: why.to_owned() });
        }
        let extraction = ExtractionSettings {
            min_duration_s: self.min_duration_s.unwrap_or(settings.min_duration_s),
            max_duration_s: self.max_duration_s.unwrap_or(settings.max_duration_s),
            min_spacing_m: self.min_spacing_m.unwrap_or(settings.min_spacing_m),
            max_spacing_m: self.max_spacing_m.unwrap_or(settings.max_spacing_m),
            max_rows: settings.max_rows,
        };
        extraction.checked().map_err(|error: ExtractionSettingsError| invalid(error.name, error.to_string()))
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
    fn criteria_are_for_recordings_of_a_road_and_its_spacing_is_net() {
        let settings = ExtractionSettings::default();
        let shorter = UploadOptions { min_duration_s: Some(5.0), ..UploadOptions::default() };
        assert_eq!(shorter.extraction(Format::Xml, &settings).unwrap().min_duration_s, 5.0);
        assert_eq!(shorter.extraction(Format::Csv, &settings).unwrap_err().code, "option_not_applicable");
        let ngsim = UploadOptions { preset: Preset::Ngsim, ..UploadOptions::default() };
        assert_eq!(ngsim.extraction(Format::Csv, &settings).unwrap(), settings);
        let front = UploadOptions { spacing: SpacingKind::Front, leader_length_m: Some(4.0), ..ngsim.clone() };
        assert_eq!(front.extraction(Format::Csv, &settings).unwrap_err().name, "spacing");
        let least = UploadOptions { min_spacing_m: Some(121.0), ..ngsim };
        let error = least.extraction(Format::Csv, &settings).unwrap_err();
        assert_eq!((error.name, error.code), ("min_spacing_m", "invalid_option"));
    }

    #[test]
    fn spacing_needs_the_lengths_of_its_definition() {
        let options = |spacing, leader_length_m, follower_length_m| UploadOptions {
            spacing,
            leader_length_m,
            follower_length_m,
            ..UploadOptions::default()
        };
        let missing = |options: UploadOptions| options.conversion(Format::Csv).unwrap_err().name;
        assert_eq!(options(SpacingKind::Net, None, None).conversion(Format::Csv).unwrap().spacing.excess_m(), 0.0);
        assert_eq!(
            options(SpacingKind::Front, Some(4.0), None).conversion(Format::Csv).unwrap().spacing.excess_m(),
            4.0
        );
        assert_eq!(
            options(SpacingKind::Centre, Some(4.0), Some(5.0)).conversion(Format::Csv).unwrap().spacing.excess_m(),
            4.5
        );
        assert_eq!(missing(options(SpacingKind::Front, None, Some(4.0))), "leader_length_m");
        assert_eq!(missing(options(SpacingKind::Centre, Some(4.0), None)), "follower_length_m");
        assert_eq!(missing(options(SpacingKind::Net, Some(-4.0), None)), "leader_length_m");
    }

    #[test]
    fn arrays_have_follownets_step_unless_the_upload_says_another() {
        let step = |dt_s, format| UploadOptions { dt_s, ..UploadOptions::default() }.conversion(format).unwrap().dt_s;
        assert_eq!(step(None, Format::Npy), Some(0.1));
        assert_eq!(step(Some(0.04), Format::Npy), Some(0.04));
        assert_eq!(step(None, Format::Csv), None);
    }
}
