//! Predictions by model, version and kind: of each model's newest versions one by one, of those before together, since a server
//! that learns for years makes more versions than anybody's monitoring can hold.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};

const NAME: &str = "headway_predictions_total";

/// What was computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PredictionKind {
    /// A window's acceleration.
    Windows,
    /// A vehicle behind a leader.
    Simulation,
}

impl PredictionKind {
    const ALL: [Self; 2] = [Self::Windows, Self::Simulation];

    fn as_str(self) -> &'static str {
        match self {
            Self::Windows => "predict",
            Self::Simulation => "simulate",
        }
    }
}

/// How often, by kind.
#[derive(Debug, Default)]
struct Counts([AtomicU64; PredictionKind::ALL.len()]);

impl Counts {
    fn add(&self, kind: PredictionKind, count: u64) {
        self.0[kind as usize].fetch_add(count, Ordering::Relaxed);
    }

    fn of(&self, kind: PredictionKind) -> u64 {
        self.0[kind as usize].load(Ordering::Relaxed)
    }
}

#[derive(Debug, Default)]
struct Model {
    versions: BTreeMap<i64, Counts>,
    older: Counts,
}

impl Model {
    /// Counts for a version that may be new; of more than `most` the oldest joins those before it.
    fn add(&mut self, most: usize, version: i64, kind: PredictionKind, count: u64) {
        self.versions.entry(version).or_default().add(kind, count);
        while self.versions.len() > most
            && let Some((_, oldest)) = self.versions.pop_first()
        {
            for kind in PredictionKind::ALL {
                self.older.add(kind, oldest.of(kind));
            }
        }
    }
}

/// The counters of one server.
#[derive(Debug)]
pub(super) struct Predictions {
    /// Most versions of a model that are counted one by one.
    most: usize,
    models: RwLock<BTreeMap<String, Model>>,
}

impl Predictions {
    pub(super) fn new(most: usize) -> Self {
        Self { most, models: RwLock::default() }
    }

    pub(super) fn add(&self, model: &str, version: i64, kind: PredictionKind, count: u64) {
        let known = self.models.read().unwrap_or_else(PoisonError::into_inner);
        if let Some(counts) = known.get(model).and_then(|model| model.versions.get(&version)) {
            return counts.add(kind, count);
        }
        drop(known);
        let mut models = self.models.write().unwrap_or_else(PoisonError::into_inner);
        models.entry(model.to_owned()).or_default().add(self.most, version, kind, count);
    }

    /// What Prometheus reads. Names of models need no escaping.
    pub(super) fn render(&self) -> String {
        let mut text = format!("# HELP {NAME} Windows predicted and simulations driven.\n# TYPE {NAME} counter\n");
        let mut line = |model: &str, version: &str, counts: &Counts| {
            for kind in PredictionKind::ALL {
                let (count, kind) = (counts.of(kind), kind.as_str());
                if count > 0 {
                    let _ = writeln!(text, "{NAME}{{model=\"{model}\",version=\"{version}\",kind=\"{kind}\"}} {count}");
                }
            }
        };
        for (name, model) in self.models.read().unwrap_or_else(PoisonError::into_inner).iter() {
            line(name, "older", &model.older);
            for (version, counts) in &model.versions {
                line(name, &version.to_string(), counts);
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_prediction_is_counted_and_only_the_newest_versions_one_by_one() {
        let predictions = Predictions::new(2);
        for version in 1..=5 {
            predictions.add("m", version, PredictionKind::Windows, 10);
        }
        predictions.add("m", 2, PredictionKind::Simulation, 1);
        predictions.add("m", 5, PredictionKind::Windows, 1);
        predictions.add("other", 1, PredictionKind::Windows, 7);
        let text = predictions.render();
        let lines: Vec<_> = text.lines().filter(|line| !line.starts_with('#')).collect();
        assert_eq!(
            lines,
            [
                r#"headway_predictions_total{model="m",version="older",kind="predict"} 30"#,
                r#"headway_predictions_total{model="m",version="older",kind="simulate"} 1"#,
                r#"headway_predictions_total{model="m",version="4",kind="predict"} 10"#,
                r#"headway_predictions_total{model="m",version="5",kind="predict"} 11"#,
                r#"headway_predictions_total{model="other",version="1",kind="predict"} 7"#,
            ]
        );
    }
}
