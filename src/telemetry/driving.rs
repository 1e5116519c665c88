//! How the live version of each model drives in the regimes of its line: what a dashboard wants to see of forgetting.
//!
//! A version's evaluation never changes, so it is read once, when the version has gone live, and told from then on.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::{PoisonError, RwLock};

use crate::lineage::RegimeEvaluation;

/// One regime.
#[derive(Debug, Clone, PartialEq)]
struct Driven {
    regime: String,
    spacing_mse: f64,
    served_spacing_mse: f64,
    collision_ratio: f64,
    served_collision_ratio: f64,
    forgetting_ratio: Option<f64>,
}

impl Driven {
    /// None without test events: nothing is known then.
    fn of(regime: &RegimeEvaluation) -> Option<Self> {
        let network = regime.measures?;
        let share = |collisions: u32| f64::from(collisions) / f64::from(network.events);
        let served = regime.served.map_or((network.spacing_mse, network.collisions), |s| (s.spacing_mse, s.collisions));
        Some(Self {
            regime: regime.regime.to_string(),
            spacing_mse: network.spacing_mse,
            served_spacing_mse: served.0,
            collision_ratio: share(network.collisions),
            served_collision_ratio: share(served.1),
            forgetting_ratio: regime.diagonal_spacing_mse.map(|diagonal| network.spacing_mse / diagonal),
        })
    }
}

#[derive(Debug, Default)]
struct Model {
    live: Option<i64>,
    regimes: Vec<Driven>,
}

/// What is known of every model.
#[derive(Debug)]
pub(super) struct Driving {
    /// Most regimes of a model that are told.
    most: usize,
    models: RwLock<BTreeMap<String, Model>>,
}

impl Driving {
    pub(super) fn new(most: usize) -> Self {
        Self { most, models: RwLock::default() }
    }

    pub(super) fn knows(&self, model: &str, live: Option<i64>) -> bool {
        let models = self.models.read().unwrap_or_else(PoisonError::into_inner);
        models.get(model).is_some_and(|model| model.live == live)
    }

    pub(super) fn set(&self, model: &str, live: Option<i64>, regimes: &[RegimeEvaluation]) {
        let mut newest: Vec<_> = regimes.iter().collect();
        newest.sort_by_key(|regime| std::cmp::Reverse(regime.learned_stage));
        newest.truncate(self.most);
        let regimes = newest.into_iter().filter_map(Driven::of).collect();
        let mut models = self.models.write().unwrap_or_else(PoisonError::into_inner);
        models.insert(model.to_owned(), Model { live, regimes });
    }

    /// What Prometheus reads. Names of models and regimes need no escaping.
    pub(super) fn render(&self) -> String {
        let models = self.models.read().unwrap_or_else(PoisonError::into_inner);
        let mut text = String::new();
        let mut metric = |name: &str, help: &str, values: &dyn Fn(&Driven) -> Vec<(&'static str, f64)>| {
            let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} gauge");
            for (model, of_model) in models.iter() {
                for driven in &of_model.regimes {
                    for (driver, value) in values(driven) {
                        let _ =
                            writeln!(text, "{name}{{model=\"{model}\",regime=\"{}\"{driver}}} {value}", driven.regime);
                    }
                }
            }
        };
        let both = |network: f64, served: f64| vec![(",driver=\"network\"", network), (",driver=\"served\"", served)];
        metric("headway_live_spacing_error_square_meters", "Spacing MSE on the regime's test events.", &|driven| {
            both(driven.spacing_mse, driven.served_spacing_mse)
        });
        metric("headway_live_collision_ratio", "Share of the regime's test events with a collision.", &|driven| {
            both(driven.collision_ratio, driven.served_collision_ratio)
        });
        let help = "The network's spacing MSE over that of the version that learned the regime last.";
        metric("headway_live_forgetting_ratio", help, &|driven| {
            driven.forgetting_ratio.map(|ratio| ("", ratio)).into_iter().collect()
        });
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lineage::{RegimeName, ServedMeasures, TestMeasures};

    fn regime(name: &str, learned_stage: u32, spacing_mse: Option<f64>) -> RegimeEvaluation {
        let measures = |spacing_mse| TestMeasures { spacing_mse, speed_mse: 1.0, collisions: 1, events: 4, steps: 9 };
        RegimeEvaluation {
            regime: RegimeName::parse(name).unwrap(),
            learned_stage,
            learned_version: 1,
            measures: spacing_mse.map(measures),
            served: Some(ServedMeasures {
                spacing_mse: 1.0,
                speed_mse: 1.0,
                collisions: 0,
                acted_steps: 0,
                held_steps: 0,
            }),
            before: None,
            diagonal_spacing_mse: Some(2.0),
            best_spacing_mse: None,
        }
    }

    #[test]
    fn the_regimes_learned_last_are_told_and_those_without_events_are_not() {
        let driving = Driving::new(2);
        assert!(!driving.knows("m", None));
        driving.set("m", None, &[]);
        assert!(driving.knows("m", None) && !driving.knows("m", Some(3)));
        driving.set(
            "m",
            Some(3),
            &[regime("old", 1, Some(9.0)), regime("fast", 3, Some(3.0)), regime("slow", 2, None)],
        );
        assert!(driving.knows("m", Some(3)));
        let text = driving.render();
        let lines: Vec<_> = text.lines().filter(|line| !line.starts_with('#')).collect();
        assert_eq!(
            lines,
            [
                r#"headway_live_spacing_error_square_meters{model="m",regime="fast",driver="network"} 3"#,
                r#"headway_live_spacing_error_square_meters{model="m",regime="fast",driver="served"} 1"#,
                r#"headway_live_collision_ratio{model="m",regime="fast",driver="network"} 0.25"#,
                r#"headway_live_collision_ratio{model="m",regime="fast",driver="served"} 0"#,
                r#"headway_live_forgetting_ratio{model="m",regime="fast"} 1.5"#,
            ]
        );
        driving.set("m", None, &[]);
        assert!(!driving.render().contains("fast"), "what no longer serves is not told");
    }
}
