//! The strength of a method, found on validation events.

use std::iter;

use serde_json::{Value, json};

use super::arguments::Strength;
use super::choice::Choice;
use super::state::StoredStage;
use super::work::{Stage, Work};
use crate::consolidation::{Method, default_strength, searched_strengths};
use crate::evaluation::{Errors, evaluate};
use crate::protocol::{Candidate, SEARCH_RULE, best};

/// Seeds that a search learns with at most: one alone cannot tell strengths apart that differ by a few per cent.
const SEEDS: usize = 3;

/// Every stage that a search for this method learns, if there is one.
pub(super) fn stages(work: &Work<'_>, method: Method) -> Vec<Stage> {
    if !is_searched(work, method) {
        return Vec::new();
    }
    let of_seed = |&seed: &u64| {
        let candidates =
            searched_strengths(method).into_iter().map(move |strength| (method, Strength::Fixed(strength)));
        let lines = iter::once((Method::Naive, Strength::Auto)).chain(candidates);
        lines.flat_map(move |(method, strength)| untraced(work, method, seed, strength))
    };
    seeds(work).iter().flat_map(of_seed).collect()
}

/// The one place where a strength is chosen: as told, else searched.
pub(super) fn choose(work: &Work<'_>, method: Method) -> anyhow::Result<Choice> {
    if is_searched(work, method) {
        return search(work, method);
    }
    Ok(Choice { strength: work.options.strength(method), search: Value::Null })
}

/// Learns all tasks in turn with each strength, with the first seeds, and takes the best on the validation events of every
/// task, also of those learned earlier. Test events are not looked at.
fn search(work: &Work<'_>, method: Method) -> anyhow::Result<Choice> {
    if let Some(task) = work.plan.tasks.iter().find(|task| task.validation.is_empty()) {
        let said = format!("task {} has no validation events, so the default strength is used", task.name);
        work.progress.say(&format!("{}: {said}", method.as_str()));
        return Ok(Choice { strength: Strength::Fixed(default_strength(method)), search: json!({ "note": said }) });
    }
    let naive = candidate(0.0, &lines(work, Method::Naive, Strength::Auto)?);
    let naive_diagonal: Vec<f64> = naive.spacing_mse.iter().enumerate().map(|(task, errors)| errors[task]).collect();
    let each = searched_strengths(method).into_iter();
    let each = each.map(|strength| Ok(candidate(strength, &lines(work, method, Strength::Fixed(strength))?)));
    let candidates = each.collect::<anyhow::Result<Vec<_>>>()?;
    let chosen =
        best(&candidates, &naive_diagonal).map_or(default_strength(method), |place| candidates[place].strength);
    work.progress.say(&format!("{}: strength {chosen}, found on validation events", method.as_str()));
    Ok(Choice { strength: Strength::Fixed(chosen), search: seen(seeds(work), chosen, &candidates, &naive_diagonal) })
}

/// Whether the strength of this method has to be found.
fn is_searched(work: &Work<'_>, method: Method) -> bool {
    method.consolidates() && work.options.strength(method) == Strength::Auto
}

fn seeds<'s>(work: &'s Work<'_>) -> &'s [u64] {
    let seeds = &work.options.seeds;
    &seeds[..seeds.len().min(SEEDS)]
}

/// The stages of one line, without what figures alone need of each candidate.
fn untraced(work: &Work<'_>, method: Method, seed: u64, strength: Strength) -> impl Iterator<Item = Stage> {
    work.stages(method, seed, strength)
        .into_iter()
        .map(move |stage| Stage { traced: stage.traced && method == Method::Naive, ..stage })
}

/// Errors on validation events: seeds × stages × tasks.
fn lines(work: &Work<'_>, method: Method, strength: Strength) -> anyhow::Result<Vec<Vec<Vec<Errors>>>> {
    let line = |&seed: &u64| {
        let line = work.line(&untraced(work, method, seed, strength).collect::<Vec<_>>())?;
        Ok(line.iter().map(|stage| validated(work, stage)).collect())
    };
    seeds(work).iter().map(line).collect()
}

/// Errors on the validation events of every task.
fn validated(work: &Work<'_>, stage: &StoredStage) -> Vec<Errors> {
    let (shape, learned) = (work.options.settings.shape(), &stage.learned);
    let on = |events| evaluate(shape, &learned.scaling, &learned.weights, events, &work.workers);
    work.plan.tasks.iter().map(|task| on(&task.validation)).collect()
}

/// What these lines of one strength came to: errors are the mean over the seeds, collisions their sum.
fn candidate(strength: f64, seeds: &[Vec<Vec<Errors>>]) -> Candidate {
    let mse = |errors: &Errors| errors.spacing_sq / errors.steps.max(1) as f64;
    let mean = |stage: usize, task: usize| {
        seeds.iter().map(|stages| mse(&stages[stage][task])).sum::<f64>() / seeds.len() as f64
    };
    let collided = |stages: &[Vec<Errors>]| {
        let seen = stages.iter().enumerate().map(|(stage, errors)| &errors[..=stage]);
        seen.map(|errors| errors.iter().map(|errors| errors.collisions).sum()).max().unwrap_or(0_u32)
    };
    let tasks = seeds[0].len();
    Candidate {
        strength,
        spacing_mse: (0..tasks).map(|stage| (0..tasks).map(|task| mean(stage, task)).collect()).collect(),
        collisions: seeds.iter().map(|stages| collided(stages)).sum(),
    }
}

/// For the report.
fn seen(seeds: &[u64], chosen: f64, candidates: &[Candidate], naive_diagonal: &[f64]) -> Value {
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
        "seeds": seeds,
        "chosen": chosen,
        "rule": SEARCH_RULE,
        "naive_diagonal": naive_diagonal,
        "candidates": each.collect::<Vec<_>>(),
    })
}
