//! Columns by name: presets and the roles their columns play.

use serde::{Deserialize, Serialize};

use super::{Format, FormatError};
use crate::formats::excerpt::shortened;

/// Names of the columns of a tabular body.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// The names of the JSON event.
    #[default]
    Headway,
    /// `FollowNet`'s: `spacing, sv_speed, rel_speed, lv_speed`.
    Follownet,
    /// NGSIM's. Not available yet.
    Ngsim,
    /// SUMO's floating-car data. Not available yet.
    Fcd,
}

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    EventId,
    Source,
    Run,
    Split,
    Time,
    Dt,
    Spacing,
    FollowerSpeed,
    LeaderSpeed,
    RelSpeed,
    /// Provenance that is not kept.
    Ignored,
}

/// Most columns of a body that are read: none twice.
pub(super) const ROLES: usize = 10;

/// In every preset.
const SHARED: [(&str, Role); 8] = [
    ("event_id", Role::EventId),
    ("source", Role::Source),
    ("run", Role::Run),
    ("split", Role::Split),
    ("t", Role::Time),
    ("dt_s", Role::Dt),
    // Which vehicles, and what drives the follower: recordings carry them, nothing here uses them.
    ("pair", Role::Ignored),
    ("follower", Role::Ignored),
];
const HEADWAY: [(&str, Role); 4] = [
    ("spacing_m", Role::Spacing),
    ("follower_speed_mps", Role::FollowerSpeed),
    ("leader_speed_mps", Role::LeaderSpeed),
    ("rel_speed_mps", Role::RelSpeed),
];
const FOLLOWNET: [(&str, Role); 4] = [
    ("spacing", Role::Spacing),
    ("sv_speed", Role::FollowerSpeed),
    ("lv_speed", Role::LeaderSpeed),
    ("rel_speed", Role::RelSpeed),
];

impl Preset {
    fn name(self) -> &'static str {
        match self {
            Self::Headway => "headway",
            Self::Follownet => "follownet",
            Self::Ngsim => "ngsim",
            Self::Fcd => "fcd",
        }
    }

    /// Whether a body of `format` can be read with this preset.
    ///
    /// # Errors
    /// `not_available` for what another release reads; `preset_not_applicable` for JSON under other names than its own.
    pub fn check(self, format: Format) -> Result<(), FormatError> {
        match (self, format) {
            (Self::Ngsim | Self::Fcd, _) => Err(FormatError::Unsupported {
                code: "not_available",
                detail: format!("preset {} is not available yet; headway and follownet are", self.name()),
            }),
            (Self::Follownet, Format::Json | Format::Ndjson) => {
                let detail = "preset follownet names columns, and a JSON event has none".to_owned();
                Err(FormatError::invalid(None, "preset_not_applicable", detail))
            }
            _ => Ok(()),
        }
    }

    fn columns(self) -> impl Iterator<Item = (&'static str, Role)> {
        let own = if self == Self::Follownet { FOLLOWNET } else { HEADWAY };
        SHARED.into_iter().chain(own)
    }

    /// The role of each of `names`.
    ///
    /// # Errors
    /// Names the columns that are unknown, doubled or missing.
    pub(super) fn roles<'n>(self, names: impl Iterator<Item = &'n str>) -> Result<Vec<Role>, FormatError> {
        let (mut roles, mut unknown) = (Vec::new(), Vec::new());
        for name in names {
            match self.columns().find(|(known, _)| *known == name) {
                Some((_, role)) if role != Role::Ignored && roles.contains(&role) => {
                    let detail = format!("column {name} is there twice");
                    return Err(FormatError::invalid(None, "duplicate_column", detail));
                }
                Some((_, role)) => roles.push(role),
                None => unknown.push(format!("{:?}", shortened(name))),
            }
        }
        let known: Vec<_> = self.columns().map(|(name, _)| name).collect();
        if !unknown.is_empty() {
            let more = unknown.len().saturating_sub(8);
            unknown.truncate(8);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            let detail = format!(
                "unknown column {}{more}; preset {} knows {}",
                unknown.join(", "),
                self.name(),
                known.join(", ")
            );
            return Err(FormatError::invalid(None, "unknown_column", detail));
        }
        let required = [Role::EventId, Role::Spacing, Role::FollowerSpeed, Role::LeaderSpeed];
        let missing = self.columns().filter(|(_, role)| required.contains(role) && !roles.contains(role));
        let missing: Vec<_> = missing.map(|(name, _)| name).collect();
        if !missing.is_empty() {
            let (s, are) = if missing.len() == 1 { ("", "is") } else { ("s", "are") };
            let detail = format!("column{s} {} of preset {} {are} missing", missing.join(", "), self.name());
            return Err(FormatError::invalid(None, "missing_column", detail));
        }
        Ok(roles)
    }
}

impl Role {
    /// Its name in a JSON event, which is how places and details name it.
    pub(super) fn field(self) -> &'static str {
        match self {
            Self::EventId => "event_id",
            Self::Source => "source",
            Self::Run => "run",
            Self::Split => "split",
            Self::Time => "t",
            Self::Dt => "dt_s",
            Self::Spacing => "spacing_m",
            Self::FollowerSpeed => "follower_speed_mps",
            Self::LeaderSpeed => "leader_speed_mps",
            Self::RelSpeed => "rel_speed_mps",
            Self::Ignored => "",
        }
    }

    /// Whether it holds numbers.
    pub(super) fn is_number(self) -> bool {
        !matches!(self, Self::EventId | Self::Source | Self::Run | Self::Split | Self::Ignored)
    }
}
