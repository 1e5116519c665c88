//! Columns by name: presets and the roles their columns play.

use serde::{Deserialize, Serialize};

use super::{Format, FormatError};
use crate::formats::excerpt::shortened;

/// What makes SUMO write who is ahead.
pub(super) const LEADERS: &str = "SUMO writes leaders when it is told --fcd-output.max-leader-distance 200, and with \
                                  --fcd-output.attributes when that names id, speed, leaderID, leaderSpeed and leaderGap";

/// Names of the columns of a tabular body.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// The names of the JSON event.
    #[default]
    Headway,
    /// `FollowNet`'s: `spacing, sv_speed, rel_speed, lv_speed`.
    Follownet,
    /// NGSIM's: every vehicle of a road at every time, in feet.
    Ngsim,
    /// SUMO's floating-car data: every vehicle of a road at every time.
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
    /// Of a whole road: the vehicle's number, or its name.
    Vehicle,
    VehicleName,
    /// Its speed.
    Speed,
    /// Its length.
    Length,
    /// Front to front.
    Headway,
    /// Who is ahead, by number or by name.
    Leader,
    LeaderName,
    /// Bumper to bumper.
    Gap,
    Frame,
    /// In milliseconds.
    Clock,
    /// Which road.
    Location,
    /// What is not kept.
    Ignored,
}

/// Most columns of a body that are read: none twice.
pub(super) const ROLES: usize = 12;

/// In every preset.
const SHARED: [(&str, Role); 3] = [("source", Role::Source), ("run", Role::Run), ("split", Role::Split)];
/// In those whose rows are steps of events.
const STEPS: [(&str, Role); 5] = [
    ("event_id", Role::EventId),
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
/// Published files differ in case, and in the name of one column.
const NGSIM: [(&str, Role); 9] = [
    ("Vehicle_ID", Role::Vehicle),
    ("Frame_ID", Role::Frame),
    ("Global_Time", Role::Clock),
    ("v_Length", Role::Length),
    ("v_Vel", Role::Speed),
    ("Preceding", Role::Leader),
    ("Space_Headway", Role::Headway),
    ("Space_Hdwy", Role::Headway),
    ("Location", Role::Location),
];
const FCD: [(&str, Role); 6] = [
    ("timestep_time", Role::Time),
    ("vehicle_id", Role::VehicleName),
    ("vehicle_speed", Role::Speed),
    ("vehicle_leaderID", Role::LeaderName),
    ("vehicle_leaderSpeed", Role::LeaderSpeed),
    ("vehicle_leaderGap", Role::Gap),
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

    /// Whether a body of `format` is a recording of a whole road, out of which events are extracted.
    #[must_use]
    pub fn is_of_road(self, format: Format) -> bool {
        self.names_vehicles() || format == Format::Xml
    }

    /// Whether a row is a vehicle at one time, and not a step of an event.
    fn names_vehicles(self) -> bool {
        matches!(self, Self::Ngsim | Self::Fcd)
    }

    /// Whether a body of `format` can be read with this preset.
    ///
    /// # Errors
    /// `preset_not_applicable` where the format has no columns, or other ones.
    pub fn check(self, format: Format) -> Result<(), FormatError> {
        let why = match (self, format) {
            (_, Format::Csv)
            | (Self::Headway | Self::Fcd, Format::Xml)
            | (Self::Headway | Self::Follownet | Self::Ngsim, Format::Parquet)
            | (Self::Headway | Self::Follownet, Format::Npy)
            | (Self::Headway, Format::Json | Format::Ndjson) => return Ok(()),
            (_, Format::Npy) => "is not what an array holds: its columns are FollowNet's",
            (_, Format::Json | Format::Ndjson) => "names columns, and a JSON event has none",
            (_, Format::Xml) => "names columns, and XML is read as preset fcd alone",
            (Self::Fcd, Format::Parquet) => "is read from XML and CSV alone",
        };
        let detail = format!("preset {} {why}", self.name());
        Err(FormatError::invalid(None, "preset_not_applicable", detail))
    }

    fn columns(self) -> impl Iterator<Item = (&'static str, Role)> {
        let (steps, own): (&[_], &[_]) = match self {
            Self::Headway => (&STEPS, &HEADWAY),
            Self::Follownet => (&STEPS, &FOLLOWNET),
            Self::Ngsim => (&[], &NGSIM),
            Self::Fcd => (&[], &FCD),
        };
        SHARED.into_iter().chain(steps.iter().copied()).chain(own.iter().copied())
    }

    fn role(self, name: &str) -> Option<Role> {
        let same = |known: &str| if self.names_vehicles() { known.eq_ignore_ascii_case(name) } else { known == name };
        self.columns().find(|(known, _)| same(known)).map(|(_, role)| role)
    }

    /// Columns without which nothing can be read.
    fn required(self) -> &'static [Role] {
        match self {
            Self::Headway | Self::Follownet => &[Role::EventId, Role::Spacing, Role::FollowerSpeed, Role::LeaderSpeed],
            Self::Ngsim => &[Role::Vehicle, Role::Frame, Role::Length, Role::Speed, Role::Leader, Role::Headway],
            Self::Fcd => &[Role::Time, Role::VehicleName, Role::Speed, Role::LeaderName, Role::LeaderSpeed, Role::Gap],
        }
    }

    /// The role of each of `names`.
    ///
    /// # Errors
    /// Names the columns that are unknown, doubled or missing.
    pub(super) fn roles<'n>(self, names: impl Iterator<Item = &'n str>) -> Result<Vec<Role>, FormatError> {
        let (mut roles, mut unknown) = (Vec::new(), Vec::new());
        for name in names {
            match self.role(name) {
                Some(role) if role != Role::Ignored && roles.contains(&role) => {
                    let detail = format!("column {name} is there twice");
                    return Err(FormatError::invalid(None, "duplicate_column", detail));
                }
                Some(role) => roles.push(role),
                // A recording of a road says much that is not needed.
                None if self.names_vehicles() => roles.push(Role::Ignored),
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
        self.complete(&roles)?;
        Ok(roles)
    }

    fn complete(self, roles: &[Role]) -> Result<(), FormatError> {
        let mut missing: Vec<&str> = Vec::new();
        for &role in self.required().iter().filter(|role| !roles.contains(role)) {
            missing.extend(self.columns().find(|(_, known)| *known == role).map(|(name, _)| name));
        }
        if missing.is_empty() {
            return Ok(());
        }
        let (s, are) = if missing.len() == 1 { ("", "is") } else { ("s", "are") };
        let mut detail = format!("column{s} {} of preset {} {are} missing", missing.join(", "), self.name());
        if self == Self::Fcd {
            detail = format!("{detail}; {LEADERS}");
        }
        Err(FormatError::invalid(None, "missing_column", detail))
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
            Self::Vehicle => "Vehicle_ID",
            Self::VehicleName => "vehicle id",
            Self::Speed => "the vehicle's speed",
            Self::Length => "v_Length",
            Self::Headway => "Space_Headway",
            Self::Leader => "Preceding",
            Self::LeaderName => "leaderID",
            Self::Gap => "leaderGap",
            Self::Frame => "Frame_ID",
            Self::Clock => "Global_Time",
            Self::Location => "Location",
            Self::Ignored => "",
        }
    }

    /// Whether it holds numbers.
    pub(super) fn is_number(self) -> bool {
        !matches!(
            self,
            Self::EventId
                | Self::Source
                | Self::Run
                | Self::Split
                | Self::VehicleName
                | Self::LeaderName
                | Self::Location
                | Self::Ignored
        )
    }
}
