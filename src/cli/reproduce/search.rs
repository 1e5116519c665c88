//! The strength of a method, found on validation events.

use serde_json::{Value, json};

use super::arguments::Strength;
use super::choice::Choice;
use super::state::StoredStage;
use super::work::{Stage, Work};
use crate::consolidation::{Method, default_strength, searched_strengths};
use crate::evaluation::{Errors, evaluate};
use crate::protocol::{Candidate, SEARCH_RULE, best};

/// Every stage that a search for this method learns, if there is one.
pub(super) fn stages(work: &Work<'_>, method: Method) -> Vec<Stage> {
    if !is_searched(work, method) {
        return Vec::new();
    }
    let naive = work.stages(Method::Naive, first_seed(work), Strength::Auto);
    let candidates = searched_strengths(method).into_iter().map(|strength| candidate_stages(work, method, strength));
    naive.into_iter().chain(candidates.flatten()).collect()
}

/// The one place where a strength is chosen: as told, else searched.
pub(super) fn choose(work: &Work<'_>, method: Method) -> anyhow::Result<Choice> {
    if is_searched(work, method) {
        return search(work, method);
    }
    Ok(Choice { strength: work.options.strength(method), search: Value::Null })
}

/// Learns all tasks in turn with each strength, with the first seed, and takes the best on the validation events of every
/// task, also of those learned earlier. Test events are not looked at.
fn search(work: &Work<'_>, method: Method) -> anyhow::Result<Choice> {
    if let Some(task) = work.plan.tasks.iter().find(|task| task.validation.is_empty()) {
        let said = format!("task {} has no validation events, so the default strength is used", task.name);
        work.progress.say(&format!("{}: {said}", method.as_str()));
        return Ok(Choice { strength: Strength::Fixed(default_strength(method)), search: json!({ "note": said }) });
    }
    let naive = work.line(&work.stages(Method::Naive, first_seed(work), Strength::Auto))?;
    let naive_diagonal: Vec<f64> = (0..naive.len()).map(|task| mse(&validated(work, &naive[task])[task])).collect();
    let mut candidates = Vec::new();
    for strength in searched_strengths(method) {
        let line = work.line(&candidate_stages(work, method, strength))?;
        candidates.push(candidate(strength, &line.iter().map(|stage| validated(work, stage)).collect::<Vec<_>>()));
    }
    let chosen =
        best(&candidates, &naive_diagonal).map_or(default_strength(method), |place| candidates[place].strength);
    work.progress.say(&format!("{}: strength {chosen}, found on validation events", method.as_str()));
    Ok(Choice {
        strength: Strength::Fixed(chosen),
        search: seen(first_seed(work), chosen, &candidates, &naive_diagonal),
    })
}

/// Whether the strength of this method has to be found.
fn is_searched(work: &Work<'_>, method: Method) -> bool {
    method.consolidates() && work.options.strength(method) == Strength::Auto
}

fn first_seed(work: &Work<'_>) -> u64 {
    work.options.seeds[0]
}

fn candidate_stages(work: &Work<'_>, method: Method, strength: f64) -> Vec<Stage> {
    let stages = work.stages(method, first_seed(work), Strength::Fixed(strength));
    stages.into_iter().map(|stage| Stage { traced: false, ..stage }).collect()
}

/// Errors on the validation events of every task.
fn validated(work: &Work<'_>, stage: &StoredStage) -> Vec<Errors> {
    let (shape, learned) = (work.options.settings.shape(), &stage.learned);
    let on = |events| evaluate(shape, &learned.scaling, &learned.weights, events, &work.workers);
    work.plan.tasks.iter().map(|task| on(&task.validation)).collect()
}

fn mse(errors: &Errors) -> f64 {
    errors.spacing_sq / errors.steps.max(1) as f64
}

fn candidate(strength: f64, stages: &[Vec<Errors>]) -> Candidate {
    let seen = |(stage, errors): (usize, &Vec<Errors>)| errors[..=stage].iter().map(|errors| errors.collisions).sum();
    Candidate {
        strength,
        spacing_mse: stages.iter().map(|errors| errors.iter().map(mse).collect()).collect(),
        collisions: stages.iter().enumerate().map(seen).max().unwrap_or(0),
    }
}

/// For the report.
fn seen(seed: u64, chosen: f64, candidates: &[Candidate], naive_diagonal: &[f64]) -> Value {
    let each = candidates.iter().map(|candidate| {
        json!({
            "strength": candidate.strength,
            "cost": candidate.cost(naive_diagonal),
            "forgetting_ratio": candidate.forgetting_ratio(),
            "plasticity_loss": candidate.plasticity_loss(naive_diagonal),
            "collisions": candidate.collisions,
            "spacing_mse": candidate.spacing_mse,
        })
    });
    json!({
        "events": "validation events of every task, also of those learned earlier",
        "seed": seed,
        "chosen": chosen,
        "rule": SEARCH_RULE,
        "naive_diagonal": naive_diagonal,
        "candidates": each.collect::<Vec<_>>(),
    })
}
