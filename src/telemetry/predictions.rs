//! Predictions by model, version and kind: of each model's newest versions one by one, of those before together, since a server
//! that learns for years makes more versions than anybody's monitoring can hold.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};
use std::time::Duration;

use super::durations::Durations;
use crate::predictor::Flag;

/// What was computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PredictionKind {
    /// Windows' accelerations.
    Windows,
    /// A vehicle behind a leader.
    Simulation,
    /// A vehicle's newest step.
    Step,
}

impl PredictionKind {
    const ALL: [Self; 3] = [Self::Windows, Self::Simulation, Self::Step];

    fn as_str(self) -> &'static str {
        match self {
            Self::Windows => "predict",
            Self::Simulation => "simulate",
            Self::Step => "step",
        }
    }
}

/// How often, how long a request took, and how many answers carried each flag.
#[derive(Debug, Default)]
struct Tally {
    count: AtomicU64,
    durations: Durations,
    flagged: [AtomicU64; Flag::ALL.len()],
}

impl Tally {
    fn absorb(&self, other: &Self) {
        self.count.fetch_add(other.count.load(Ordering::Relaxed), Ordering::Relaxed);
        self.durations.absorb(&other.durations);
        for (own, counted) in self.flagged.iter().zip(&other.flagged) {
            own.fetch_add(counted.load(Ordering::Relaxed), Ordering::Relaxed);
        }
    }
}

/// Those of a version, by kind.
type Tallies = [Tally; PredictionKind::ALL.len()];

#[derive(Debug, Default)]
struct Model {
    versions: BTreeMap<i64, Tallies>,
    older: Tallies,
}

impl Model {
    /// Room for a version that may be new; of more than `most` the oldest joins those before it.
    fn admit(&mut self, most: usize, version: i64) -> &Tallies {
        self.versions.entry(version).or_default();
        while self.versions.len() > most
            && let Some((_, oldest)) = self.versions.pop_first()
        {
            for (own, counted) in self.older.iter().zip(&oldest) {
                own.absorb(counted);
            }
        }
        self.versions.get(&version).unwrap_or(&self.older)
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

    /// One request was answered, with the flags of each of its answers.
    pub(super) fn add<'f>(
        &self,
        model: &str,
        version: i64,
        kind: PredictionKind,
        took: Duration,
        flags: impl ExactSizeIterator<Item = &'f [Flag]>,
    ) {
        let tally = |tallies: &Tallies| {
            let tally = &tallies[kind as usize];
            tally.count.fetch_add(flags.len() as u64, Ordering::Relaxed);
            tally.durations.add(took);
            for &flag in flags.flatten() {
                tally.flagged[flag as usize].fetch_add(1, Ordering::Relaxed);
            }
        };
        let known = self.models.read().unwrap_or_else(PoisonError::into_inner);
        if let Some(tallies) = known.get(model).and_then(|model| model.versions.get(&version)) {
            return tally(tallies);
        }
        drop(known);
        let mut models = self.models.write().unwrap_or_else(PoisonError::into_inner);
        tally(models.entry(model.to_owned()).or_default().admit(self.most, version));
    }

    /// What Prometheus reads: metric by metric, as its format wants them. Names of models need no escaping.
    pub(super) fn render(&self) -> String {
        let models = self.models.read().unwrap_or_else(PoisonError::into_inner);
        let mut text = String::new();
        let mut metric = |name: &str, of: &str, help: &str, write: &dyn Fn(&Tally, &str, &mut String)| {
            let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {of}");
            for (model, of_model) in models.iter() {
                let mut write_each = |version: &str, tallies: &Tallies| {
                    for (kind, tally) in PredictionKind::ALL.iter().zip(tallies) {
                        let kind = kind.as_str();
                        write(tally, &format!("model=\"{model}\",version=\"{version}\",kind=\"{kind}\""), &mut text);
                    }
                };
                write_each("older", &of_model.older);
                for (version, tallies) in &of_model.versions {
                    write_each(&version.to_string(), tallies);
                }
            }
        };
        let name = "headway_predictions_total";
        metric(name, "counter", "Windows and steps predicted, simulations driven.", &|tally, labels, text| {
            let count = tally.count.load(Ordering::Relaxed);
            if count > 0 {
                let _ = writeln!(text, "{name}{{{labels}}} {count}");
            }
        });
        let name = "headway_prediction_flags_total";
        metric(name, "counter", "Answers that carried the flag.", &|tally, labels, text| {
            for (flag, count) in Flag::ALL.iter().zip(&tally.flagged) {
                let (flag, count) = (flag.as_str(), count.load(Ordering::Relaxed));
                if count > 0 {
                    let _ = writeln!(text, "{name}{{{labels},flag=\"{flag}\"}} {count}");
                }
            }
        });
        let name = "headway_prediction_duration_seconds";
        let help = "From a request that is read to its answer, waiting included.";
        metric(name, "histogram", help, &|tally, labels, text| tally.durations.render(name, labels, text));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines_of(text: &str, name: &str) -> Vec<String> {
        text.lines().filter(|line| line.starts_with(&format!("{name}{{"))).map(str::to_owned).collect()
    }

    #[test]
    fn every_prediction_is_counted_and_only_the_newest_versions_one_by_one() {
        let predictions = Predictions::new(2);
        let add = |model: &str, version, kind, flags: &[&[Flag]]| {
            predictions.add(model, version, kind, Duration::from_millis(1), flags.iter().copied());
        };
        for version in 1..=5 {
            add("m", version, PredictionKind::Windows, &[&[][..]; 10]);
        }
        add("m", 2, PredictionKind::Simulation, &[&[Flag::Envelope]]);
        add("m", 5, PredictionKind::Windows, &[&[Flag::OutOfRange, Flag::Envelope]]);
        add("other", 1, PredictionKind::Windows, &[&[][..]; 7]);
        let text = predictions.render();
        assert_eq!(
            lines_of(&text, "headway_predictions_total"),
            [
                r#"headway_predictions_total{model="m",version="older",kind="predict"} 30"#,
                r#"headway_predictions_total{model="m",version="older",kind="simulate"} 1"#,
                r#"headway_predictions_total{model="m",version="4",kind="predict"} 10"#,
                r#"headway_predictions_total{model="m",version="5",kind="predict"} 11"#,
                r#"headway_predictions_total{model="other",version="1",kind="predict"} 7"#,
            ]
        );
        assert_eq!(
            lines_of(&text, "headway_prediction_flags_total"),
            [
                r#"headway_prediction_flags_total{model="m",version="older",kind="simulate",flag="envelope"} 1"#,
                r#"headway_prediction_flags_total{model="m",version="5",kind="predict",flag="out_of_range"} 1"#,
                r#"headway_prediction_flags_total{model="m",version="5",kind="predict",flag="envelope"} 1"#,
            ]
        );
        assert_eq!(
            lines_of(&text, "headway_prediction_duration_seconds_count"),
            [
                r#"headway_prediction_duration_seconds_count{model="m",version="older",kind="predict"} 3"#,
                r#"headway_prediction_duration_seconds_count{model="m",version="older",kind="simulate"} 1"#,
                r#"headway_prediction_duration_seconds_count{model="m",version="4",kind="predict"} 1"#,
                r#"headway_prediction_duration_seconds_count{model="m",version="5",kind="predict"} 2"#,
                r#"headway_prediction_duration_seconds_count{model="other",version="1",kind="predict"} 1"#,
            ]
        );
    }
}
