//! Old traffic against new over λ: stage 2 learned with several strengths.

use super::arguments::Strength;
use super::choice::Choice;
use super::results::Learnt;
use super::state::StoredStage;
use super::work::{Stage, Work};
use crate::consolidation::{Method, default_strength};
use crate::evaluation::Errors;
use crate::training::Line;

/// Times the strength that is used, which is learned anyway.
const FACTORS: [f64; 4] = [0.01, 0.1, 10.0, 100.0];

/// One method's errors over λ.
pub(super) struct Sweep {
    pub(super) method: Method,
    /// λ ascending.
    pub(super) points: Vec<Point>,
}

/// After stage 2 with one λ.
pub(super) struct Point {
    pub(super) lambda: f64,
    /// Of each task, m².
    pub(super) spacing_mse: Vec<f64>,
}

/// Stage 2 of the first seed with each of the other strengths.
pub(super) fn stages(work: &Work<'_>, method: Method, choice: &Choice) -> Vec<Stage> {
    if !method.consolidates() {
        return Vec::new();
    }
    let used = work.stages(method, work.options.seeds[0], choice.strength).swap_remove(1);
    let with = |factor: f64| {
        let strength = match choice.strength {
            Strength::Auto => Strength::Fixed(factor * default_strength(method)),
            Strength::Fixed(strength) => Strength::Fixed(factor * strength),
            Strength::Lambda(lambda) => Strength::Lambda(factor * lambda),
        };
        Stage { strength, traced: false, ..used.clone() }
    };
    FACTORS.into_iter().map(with).collect()
}

/// Learns them, from the stage 1 that there is.
pub(super) fn sweep(work: &Work<'_>, learnt: &Learnt) -> anyhow::Result<Sweep> {
    let mut line = Line::default();
    line.advance(&learnt.seeds[0][0].learned);
    let mut points = vec![point(&learnt.seeds[0][1])];
    for stage in stages(work, learnt.method, &learnt.choice) {
        points.push(point(&work.stage(&stage, &line)?));
    }
    points.sort_by(|a, b| a.lambda.total_cmp(&b.lambda));
    Ok(Sweep { method: learnt.method, points })
}

fn point(stage: &StoredStage) -> Point {
    let pooled = |errors: &Vec<Errors>| {
        let sum: f64 = errors.iter().map(|errors| errors.spacing_sq).sum();
        sum / errors.iter().map(|errors| errors.steps as f64).sum::<f64>()
    };
    let spacing_mse = stage.measured.alone.iter().map(pooled).collect();
    Point { lambda: stage.learned.lambda.unwrap_or_default(), spacing_mse }
}
