//! Which regime an event belongs to, and when the waiting events of a regime become a task.

use serde::{Deserialize, Serialize};

use super::RegimeName;

/// A model's rule for the regime of an event: the wire's `regimes`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "\"label\" or {by: \"mean_speed_mps\", edges, names} is needed")]
pub enum RegimeRule {
    /// The upload's `regime`, else `default`.
    Label(LabelRule),
    /// The band of its mean follower speed.
    Bands(SpeedBands),
}

/// The literal `"label"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LabelRule {
    /// The upload's `regime`, else `default`.
    Label,
}

/// The literal `"mean_speed_mps"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BandedBy {
    /// Mean follower speed over the event, m/s.
    MeanSpeedMps,
}

/// Bands (low, high] of the mean follower speed, m/s.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeedBands {
    /// What is banded.
    pub by: BandedBy,
    /// Ascending edges; n edges make n + 1 bands.
    pub edges: Vec<f64>,
    /// Names from slow to fast; `band-0`, `band-1`, … where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub names: Option<Vec<RegimeName>>,
}

impl SpeedBands {
    /// Why these bands cannot be used, if they cannot.
    #[must_use]
    pub fn defect(&self) -> Option<String> {
        if self.edges.is_empty() || self.edges.len() > 63 {
            return Some("1 to 63 edges are needed".to_owned());
        }
        if !self.edges.iter().all(|e| e.is_finite()) || !self.edges.is_sorted_by(|a, b| a < b) {
            return Some("edges must be finite and ascending".to_owned());
        }
        let names = self.names.as_ref()?;
        if names.len() != self.edges.len() + 1 {
            return Some(format!("{} edges need {} names, slow to fast", self.edges.len(), self.edges.len() + 1));
        }
        let distinct: std::collections::BTreeSet<_> = names.iter().collect();
        (distinct.len() != names.len()).then(|| "names must differ".to_owned())
    }

    fn name(&self, band: usize) -> RegimeName {
        match &self.names {
            Some(names) => names[band].clone(),
            None => RegimeName::parse(&format!("band-{band}")).expect("a band's name is well formed"),
        }
    }
}

impl RegimeRule {
    /// The default rule.
    pub const LABEL: Self = Self::Label(LabelRule::Label);

    /// The regime of an event uploaded with `label`, of this mean follower speed.
    #[must_use]
    pub fn regime(&self, label: Option<&RegimeName>, mean_speed_mps: f64) -> RegimeName {
        match self {
            Self::Label(_) => label.cloned().unwrap_or_else(|| RegimeName::parse("default").expect("well formed")),
            Self::Bands(bands) => bands.name(bands.edges.partition_point(|&edge| mean_speed_mps > edge)),
        }
    }
}

/// When pending events of a regime become a task by themselves: the wire's `schedule`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "\"manual\" or {min_events, max_wait_s} is needed")]
pub enum Schedule {
    /// Only on request.
    Manual(ManualSchedule),
    /// By count or by age, whichever comes first.
    Automatic(AutomaticSchedule),
}

/// The literal `"manual"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ManualSchedule {
    /// Only on request.
    Manual,
}

/// So many events, or so much time since the oldest of them arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AutomaticSchedule {
    /// As soon as so many events of a regime are pending.
    pub min_events: u32,
    /// Or as soon as the oldest of them has waited so long, s.
    pub max_wait_s: u32,
}

impl Schedule {
    /// Whether `pending` events of a regime, the oldest of which arrived `waited_s` ago, are due.
    #[must_use]
    pub fn is_due(&self, pending: u64, waited_s: f64) -> bool {
        match self {
            Self::Manual(_) => false,
            Self::Automatic(when) => {
                pending > 0 && (pending >= u64::from(when.min_events) || waited_s >= f64::from(when.max_wait_s))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_open_below_and_closed_above() {
        let rule: RegimeRule = serde_json::from_str(
            r#"{"by": "mean_speed_mps", "edges": [9.86, 12.46], "names": ["slow", "middle", "fast"]}"#,
        )
        .unwrap();
        let name = |speed| rule.regime(None, speed).as_str().to_owned();
        assert_eq!(
            [name(3.0), name(9.86), name(9.87), name(12.46), name(12.47)],
            ["slow", "slow", "middle", "middle", "fast"]
        );
    }

    #[test]
    fn a_label_falls_back_to_default() {
        let rule: RegimeRule = serde_json::from_str(r#""label""#).unwrap();
        let site = RegimeName::parse("site-12").unwrap();
        assert_eq!(rule.regime(Some(&site), 1.0), site);
        assert_eq!(rule.regime(None, 1.0).as_str(), "default");
    }

    #[test]
    fn defective_bands_are_named() {
        let bands = |edges: &[f64], names: Option<&[&str]>| SpeedBands {
            by: BandedBy::MeanSpeedMps,
            edges: edges.to_vec(),
            names: names.map(|n| n.iter().map(|n| RegimeName::parse(n).unwrap()).collect()),
        };
        assert!(bands(&[1.0, 2.0], None).defect().is_none());
        assert!(bands(&[], None).defect().is_some());
        assert!(bands(&[2.0, 1.0], None).defect().is_some());
        assert!(bands(&[1.0], Some(&["a"])).defect().is_some());
        assert!(bands(&[1.0], Some(&["a", "a"])).defect().is_some());
    }

    #[test]
    fn a_schedule_is_due_by_count_or_by_age() {
        let schedule: Schedule = serde_json::from_str(r#"{"min_events": 500, "max_wait_s": 3600}"#).unwrap();
        assert!(schedule.is_due(500, 0.0));
        assert!(schedule.is_due(1, 3600.0));
        assert!(!schedule.is_due(499, 3599.0));
        assert!(!schedule.is_due(0, 1e9));
        let manual: Schedule = serde_json::from_str(r#""manual""#).unwrap();
        assert!(!manual.is_due(1_000_000, 1e9));
    }
}
