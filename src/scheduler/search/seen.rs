//! What a search saw: the choice, and its record.

use super::state::Row;
use crate::consolidation::default_strength;
use crate::evaluation::Errors;
use crate::lineage::{SearchedRegime, SearchedStrength, StrengthSearch};
use crate::protocol::{SEARCH_RULE, Weighed, best_of, stage_diagonal, weigh_stage};
use crate::scheduler::stage::{Stage, Validated};

const EVENTS: &str = "validation events of the task and of every regime its line learned earlier; no test events";

/// What was measured, ready to be weighed.
pub(super) struct Seen {
    /// One a regime; none where it has no validation events.
    naive_diagonal: Vec<Option<f64>>,
    unpenalised_diverged: bool,
    candidates: Vec<(f64, Result<Measured, String>)>,
}

/// One candidate.
struct Measured {
    /// One a regime.
    spacing_mse: Vec<Option<f64>>,
    weighed: Weighed,
}

/// m²; none without steps.
fn mse(errors: &Errors) -> Option<f64> {
    (errors.steps > 0).then(|| errors.spacing_sq / errors.steps as f64)
}

fn all_mse(errors: &[Errors]) -> Vec<Option<f64>> {
    errors.iter().map(mse).collect()
}

/// On the regime that is learned, the last.
fn new_mse(row: &Row) -> Option<f64> {
    mse(row.measured()?.last()?)
}

impl Seen {
    /// From the rows of the parent, the stage without a penalty and one candidate a strength.
    pub(super) fn of(rows: &[Row], strengths: &[f64]) -> Self {
        let [parent, unpenalised, candidates @ ..] = rows else {
            panic!("a search measures its parent and a reference")
        };
        let parent = all_mse(parent.measured().unwrap_or_default());
        let (_, earlier) = parent.split_last().expect("the new regime is measured");
        let tried: Vec<f64> = candidates.iter().filter_map(new_mse).collect();
        let known: Vec<f64> = earlier.iter().copied().flatten().collect();
        let diagonal = stage_diagonal(&known, new_mse(unpenalised), &tried).unwrap_or_default();
        let weigh = |(row, &strength): (&Row, &f64)| {
            let measured = match (row.measured(), row.divergence()) {
                (Some(errors), _) => {
                    let spacing_mse = all_mse(errors);
                    let after: Vec<f64> = spacing_mse.iter().copied().flatten().collect();
                    let collisions = errors.iter().map(|errors| errors.collisions).sum();
                    Ok(Measured { weighed: weigh_stage(strength, &after, &diagonal, collisions), spacing_mse })
                }
                (None, error) => Err(error.map(|error| error.to_string()).unwrap_or_default()),
            };
            (strength, measured)
        };
        Self {
            naive_diagonal: earlier.iter().copied().chain([diagonal.last().copied()]).collect(),
            unpenalised_diverged: unpenalised.measured().is_none(),
            candidates: candidates.iter().zip(strengths).map(weigh).collect(),
        }
    }

    /// The strength to learn with; none when every candidate diverged.
    pub(super) fn chosen(&self) -> Option<f64> {
        let weighed = self.candidates.iter().filter_map(|(_, measured)| Some(measured.as_ref().ok()?.weighed));
        let weighed: Vec<Weighed> = weighed.collect();
        best_of(&weighed).map(|place| weighed[place].strength)
    }
}

/// For the version.
pub(super) fn record(stage: &Stage, validated: &[Validated], seen: &Seen, chosen: f64) -> StrengthSearch {
    let note = seen.unpenalised_diverged.then(|| {
        "without a penalty training diverged: the least error of the candidates on the new regime stands in".to_owned()
    });
    let candidates = seen.candidates.iter().map(|(strength, measured)| {
        let (measured, diverged) = match measured {
            Ok(measured) => (Some(measured), None),
            Err(detail) => (None, Some(detail.clone())),
        };
        SearchedStrength {
            strength: *strength,
            cost: measured.map(|measured| measured.weighed.cost),
            forgetting_ratio: measured.map(|measured| measured.weighed.forgetting_ratio),
            plasticity_loss: measured.map(|measured| measured.weighed.plasticity_loss),
            collisions: measured.map(|measured| measured.weighed.collisions),
            spacing_mse: measured.map(|measured| measured.spacing_mse.clone()),
            diverged,
        }
    });
    StrengthSearch {
        naive_diagonal: seen.naive_diagonal.clone(),
        candidates: candidates.collect(),
        note,
        ..about(stage, validated, chosen)
    }
}

/// For a version whose strength could not be searched, because of `note`.
pub(in crate::scheduler) fn not_searched(stage: &Stage, validated: &[Validated], note: &str) -> StrengthSearch {
    let chosen = default_strength(stage.model.method);
    StrengthSearch { note: Some(note.to_owned()), ..about(stage, validated, chosen) }
}

fn about(stage: &Stage, validated: &[Validated], chosen: f64) -> StrengthSearch {
    let regime = |of: &Validated| SearchedRegime {
        regime: of.regime.clone(),
        events: u32::try_from(of.events.len()).unwrap_or(u32::MAX),
        earlier: of.regime != stage.task.regime,
    };
    StrengthSearch {
        events: EVENTS.to_owned(),
        regimes: validated.iter().map(regime).collect(),
        seed: stage.settings.seed,
        chosen,
        rule: SEARCH_RULE.to_owned(),
        note: None,
        naive_diagonal: Vec::new(),
        candidates: Vec::new(),
    }
}
