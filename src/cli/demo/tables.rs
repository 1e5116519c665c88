//! Tables for a terminal: what a version makes of every regime, stage by stage, the models side by side.

use super::answers::{Evaluation, RegimeMeasures};

/// Width of a column.
const COLUMN: usize = 9;
/// Width of the first column.
const FIRST: usize = 14;
/// Between two models.
const GAP: &str = "   ";

/// What a model made, stage by stage.
pub(super) struct Learned<'a> {
    pub(super) model: &'a str,
    pub(super) evaluations: Vec<&'a Evaluation>,
}

/// One of the numbers of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Measure {
    Spacing,
    Speed,
    Collisions,
}

impl Measure {
    pub(super) const ALL: [Self; 3] = [Self::Spacing, Self::Speed, Self::Collisions];

    fn title(self) -> &'static str {
        match self {
            Self::Spacing => "Spacing, mean squared error, m²",
            Self::Speed => "Speed, mean squared error, m²/s²",
            Self::Collisions => "Collisions, % of the test events",
        }
    }

    fn of(self, measures: &RegimeMeasures) -> Option<f64> {
        match self {
            Self::Spacing => measures.spacing_mse,
            Self::Speed => measures.speed_mse,
            Self::Collisions => measures.collision_rate_percent,
        }
    }

    fn shown(self, value: f64) -> String {
        match self {
            Self::Spacing => format!("{value:.2}"),
            Self::Speed => format!("{value:.3}"),
            Self::Collisions => format!("{value:.1}"),
        }
    }
}

/// Stages × regimes of one measure; none where a regime is not learned yet or has no test events.
pub(super) fn matrix(evaluations: &[&Evaluation], regimes: &[&str], measure: Measure) -> Vec<Vec<Option<f64>>> {
    let cell = |evaluation: &Evaluation, regime: &str| {
        evaluation.tasks.iter().find(|task| task.regime == regime).and_then(|task| measure.of(task))
    };
    let row = |evaluation: &&Evaluation| regimes.iter().map(|regime| cell(evaluation, regime)).collect();
    evaluations.iter().map(row).collect()
}

/// One measure of every model: a row for each stage, a column for each regime.
pub(super) fn stages(models: &[Learned<'_>], regimes: &[&str], measure: Measure) -> String {
    let width = COLUMN * regimes.len();
    let heads: String = models.iter().map(|learned| GAP.to_owned() + &right(learned.model, width)).collect();
    let names: String = regimes.iter().map(|regime| right(regime, COLUMN)).collect();
    let mut lines = vec![
        format!("{}\n", measure.title()),
        line(&format!("{:FIRST$}{heads}", "")),
        line(&format!("{:FIRST$}{}", "", format!("{GAP}{names}").repeat(models.len()))),
    ];
    let matrices: Vec<_> = models.iter().map(|learned| matrix(&learned.evaluations, regimes, measure)).collect();
    for (stage, regime) in regimes.iter().enumerate() {
        let mut text = format!("{:FIRST$}", format!("after {regime}"));
        for matrix in &matrices {
            text.push_str(GAP);
            for place in 0..regimes.len() {
                let value = matrix.get(stage).and_then(|row| row[place]);
                text.push_str(&right(&value.map_or_else(unknown, |value| measure.shown(value)), COLUMN));
            }
        }
        lines.push(line(&text));
    }
    lines.concat()
}

/// The last error of each regime over the error when it had just been learned, of every model.
pub(super) fn forgetting(models: &[(&str, Vec<Option<f64>>)], regimes: &[&str]) -> String {
    let heads: String = models.iter().map(|(model, _)| right(model, COLUMN)).collect();
    let mut lines = vec![
        "Forgetting: last spacing error / error when just learned\n".to_owned(),
        line(&format!("{:FIRST$}{GAP}{heads}", "")),
    ];
    for (place, regime) in regimes.iter().enumerate() {
        let ratio = |ratios: &[Option<f64>]| ratios[place].map_or_else(unknown, |ratio| format!("{ratio:.2}×"));
        let cells: String = models.iter().map(|(_, ratios)| right(&ratio(ratios), COLUMN)).collect();
        lines.push(line(&format!("{regime:FIRST$}{GAP}{cells}")));
    }
    lines.concat()
}

/// A cell with nothing to say.
fn unknown() -> String {
    "–".to_owned()
}

fn right(text: &str, width: usize) -> String {
    format!("{text:>width$}")
}

fn line(text: &str) -> String {
    format!("  {}\n", text.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evaluation(stage: u32, values: &[(&str, Option<f64>)]) -> Evaluation {
        let tasks = values.iter().map(|&(regime, value)| RegimeMeasures {
            regime: regime.to_owned(),
            events: 9,
            spacing_mse: value,
            speed_mse: value,
            collision_rate_percent: value,
            forgetting_ratio: None,
        });
        Evaluation { version: stage.into(), stage, tasks: tasks.collect() }
    }

    #[test]
    fn tables_are_aligned_and_say_what_is_not_known() {
        let first = evaluation(1, &[("fast", Some(1.234))]);
        let second = evaluation(2, &[("fast", Some(123.456)), ("slow", None)]);
        let learned = |model| Learned { model, evaluations: vec![&first, &second] };
        assert_eq!(
            stages(&[learned("ewc"), learned("naive")], &["fast", "slow"], Measure::Spacing),
            "\
Spacing, mean squared error, m²
                                  ewc                naive
                        fast     slow        fast     slow
  after fast            1.23        –        1.23        –
  after slow          123.46        –      123.46        –
"
        );
    }

    #[test]
    fn forgetting_has_a_row_for_each_regime() {
        let models = [("ewc", vec![Some(1.038), None]), ("naive", vec![Some(2.3), Some(0.99)])];
        assert_eq!(
            forgetting(&models, &["fast", "middle"]),
            "\
Forgetting: last spacing error / error when just learned
                         ewc    naive
  fast                 1.04×    2.30×
  middle                   –    0.99×
"
        );
    }
}
