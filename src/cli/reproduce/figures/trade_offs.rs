//! Old traffic against new: over λ, and over the updates of a stage.

use super::palette;
use super::panel::{Axis, Panel, legend};
use super::svg::{Anchor, Stroke, Svg};
use crate::cli::reproduce::plan::Plan;
use crate::cli::reproduce::results::{Learnt, Results};
use crate::cli::reproduce::sweep::Sweep;

/// (e) After stage 2, the error on both tasks over λ; and one against the other.
pub(super) fn over_lambda(plan: &Plan, sweeps: &[Sweep]) -> String {
    let mut svg = Svg::new(60.0 + 340.0 * (sweeps.len() + 1) as f64, 370.0);
    let names = [&plan.tasks[0].name, &plan.tasks[1].name];
    for (place, sweep) in sweeps.iter().enumerate() {
        let points = sweep.points.iter().filter(|point| point.lambda > 0.0);
        let panel = Panel {
            left: 75.0 + 340.0 * place as f64,
            top: 75.0,
            width: 250.0,
            height: 225.0,
            x: Axis::logarithmic("λ", points.clone().map(|point| point.lambda)),
            y: Axis::from_zero(
                "spacing error after stage 2, m²",
                points.clone().flat_map(|point| [point.spacing_mse[0], point.spacing_mse[1]]),
            ),
        };
        panel.frame(&mut svg, sweep.method.as_str());
        for task in 0..2 {
            let curve: Vec<_> = points.clone().map(|point| (point.lambda, point.spacing_mse[task])).collect();
            panel.curve(&mut svg, &curve, palette::task(task));
            for &point in &curve {
                svg.dot(panel.at(point), palette::task(task).color);
            }
        }
    }
    let all = || sweeps.iter().flat_map(|sweep| &sweep.points);
    let panel = Panel {
        left: 75.0 + 340.0 * sweeps.len() as f64,
        top: 75.0,
        width: 250.0,
        height: 225.0,
        x: Axis::linear(&format!("error on {} (new), m²", names[1]), all().map(|point| point.spacing_mse[1])),
        y: Axis::linear(&format!("error on {} (old), m²", names[0]), all().map(|point| point.spacing_mse[0])),
    };
    panel.frame(&mut svg, "old against new");
    for sweep in sweeps {
        let curve: Vec<_> = sweep.points.iter().map(|point| (point.spacing_mse[1], point.spacing_mse[0])).collect();
        let stroke = palette::model(sweep.method.as_str());
        panel.curve(&mut svg, &curve, stroke);
        for &point in &curve {
            svg.dot(panel.at(point), stroke.color);
        }
    }
    let tasks = names
        .into_iter()
        .enumerate()
        .map(|(task, name)| (format!("{name} ({})", ["old", "new"][task]), palette::task(task)));
    let methods = sweeps.iter().map(|sweep| (sweep.method.as_str().to_owned(), palette::model(sweep.method.as_str())));
    legend(&mut svg, (75.0, 30.0), &tasks.collect::<Vec<_>>());
    legend(&mut svg, (panel.left, 30.0), &methods.collect::<Vec<_>>());
    svg.finish()
}

/// (e) Over the updates of each stage after the first: the error on the task that is learned and on those learned before,
/// on some test events, first seed. Old tasks dip when a stage begins and recover: the stability gap.
pub(super) fn over_updates(plan: &Plan, results: &Results) -> String {
    let in_turn: Vec<&Learnt> =
        results.methods.iter().filter(|learnt| learnt.tally.stages() == plan.tasks.len()).collect();
    let stages = plan.tasks.len() - 1;
    let errors = |learnt: &Learnt, stage: usize| {
        let points = learnt.seeds[0][stage].trace.iter();
        points.flat_map(|point| point.spacing_mse[..=stage].to_vec()).collect::<Vec<_>>()
    };
    let mut svg = Svg::new(60.0 + 340.0 * stages as f64, 70.0 + 265.0 * in_turn.len() as f64);
    for (row, learnt) in in_turn.iter().enumerate() {
        for stage in 1..=stages {
            let trace = &learnt.seeds[0][stage].trace;
            let seen = 0..=stage;
            let panel = Panel {
                left: 75.0 + 340.0 * (stage - 1) as f64,
                top: 75.0 + 265.0 * row as f64,
                width: 250.0,
                height: 165.0,
                x: Axis::from_zero("update", trace.iter().map(|point| point.update as f64)),
                // One scale for all methods, so that the panels of a stage can be compared.
                y: Axis::from_zero("spacing error, m²", in_turn.iter().flat_map(|learnt| errors(learnt, stage))),
            };
            panel.frame(&mut svg, &format!("{}: learning {}", learnt.method.as_str(), plan.tasks[stage].name));
            for task in seen {
                let curve: Vec<_> = trace.iter().map(|point| (point.update as f64, point.spacing_mse[task])).collect();
                let width = if task == stage { 2.4 } else { 1.6 };
                panel.curve(&mut svg, &curve, Stroke { width, ..palette::task(task) });
            }
        }
    }
    let entries: Vec<_> =
        plan.tasks.iter().enumerate().map(|(task, of)| (of.name.clone(), palette::task(task))).collect();
    legend(&mut svg, (75.0, 30.0), &entries);
    if in_turn.is_empty() {
        svg.text((75.0, 60.0), 12.0, Anchor::Start, "#333", "no method learns in turn");
    }
    svg.finish()
}
