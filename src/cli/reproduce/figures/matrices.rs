//! Errors over stages: heat maps and forgetting curves.

use super::palette;
use super::panel::{Axis, Panel, legend};
use super::svg::{Anchor, Stroke, Svg};
use crate::cli::reproduce::plan::Plan;
use crate::cli::reproduce::results::{Learnt, Results};
use crate::consolidation::Method;
use crate::protocol::Measure;

const CELL: (f64, f64) = (74.0, 40.0);
/// Of all panels of the picture side by side.
const COLUMNS: usize = 3;

/// (c) R of every method: rows are stages, columns tasks, in the order learned.
pub(super) fn heat_maps(plan: &Plan, results: &Results) -> String {
    let tasks = plan.tasks.len() as f64;
    let (width, height) = (110.0 + CELL.0 * tasks, 85.0 + CELL.1 * tasks);
    let (rows, columns) = (results.methods.len().div_ceil(COLUMNS), results.methods.len().min(COLUMNS));
    let mut svg = Svg::new(20.0 + width * columns as f64, 40.0 + height * rows as f64);
    svg.text(
        (15.0, 24.0),
        13.0,
        Anchor::Start,
        "#111",
        "Spacing error on the test events, m²: after each stage (row), on each task (column)",
    );
    let all: Vec<_> = results.methods.iter().map(|learnt| results.matrix(&learnt.tally, Measure::Spacing)).collect();
    let span =
        |pick: fn(f64, f64) -> f64, from: f64| all.iter().flatten().flatten().fold(from, |a, &b| pick(a, b)).ln();
    let (low, high) = (span(f64::min, f64::INFINITY), span(f64::max, 1e-9));
    for (place, (learnt, matrix)) in results.methods.iter().zip(&all).enumerate() {
        let left = 15.0 + width * (place % COLUMNS) as f64;
        let top = 40.0 + height * (place / COLUMNS) as f64;
        svg.text((left + 90.0, top + 18.0), 14.0, Anchor::Start, "#111", learnt.method.as_str());
        for (column, task) in plan.tasks.iter().enumerate() {
            let x = left + 90.0 + CELL.0 * (column as f64 + 0.5);
            svg.text((x, top + 36.0), 11.0, Anchor::Middle, "#333", &shortened(&task.name));
        }
        for (row, cells) in matrix.iter().enumerate() {
            let y = top + 42.0 + CELL.1 * row as f64;
            let name = if matrix.len() == 1 {
                "all".to_owned()
            } else {
                format!("after {}", shortened(&plan.tasks[row].name))
            };
            svg.text((left + 84.0, y + 24.0), 11.0, Anchor::End, "#333", &name);
            for (column, &cell) in cells.iter().enumerate() {
                let share = (cell.ln() - low) / (high - low).max(1e-9);
                let (fill, ink) = palette::heat(share);
                let x = left + 90.0 + CELL.0 * column as f64;
                svg.rectangle((x, y), (CELL.0 - 2.0, CELL.1 - 2.0), &fill);
                // What is not learned yet is told apart from what is.
                let text = if column > row && matrix.len() > 1 { format!("({cell:.2})") } else { format!("{cell:.2}") };
                svg.text((x + CELL.0 / 2.0 - 1.0, y + 24.0), 13.0, Anchor::Middle, ink, &text);
            }
        }
    }
    svg.finish()
}

/// (c) The error on each task from the stage that learned it on.
pub(super) fn forgetting(plan: &Plan, results: &Results) -> String {
    let tasks = plan.tasks.len();
    let shown = tasks - 1;
    let (columns, rows) = (shown.min(COLUMNS), shown.div_ceil(COLUMNS));
    let mut svg = Svg::new(60.0 + 330.0 * columns as f64, 70.0 + 300.0 * rows as f64);
    let learnt: Vec<_> = results.methods.iter().filter(|learnt| learnt.tally.stages() == tasks).collect();
    for task in 0..shown {
        let curve = |learnt: &&Learnt| {
            let matrix = results.matrix(&learnt.tally, Measure::Spacing);
            (task..tasks).map(|stage| (stage as f64 + 1.0, matrix[stage][task])).collect::<Vec<_>>()
        };
        let curves: Vec<_> = learnt.iter().map(|learnt| (learnt.method.as_str(), curve(learnt))).collect();
        let joint = results.method(Method::Joint);
        let joint = joint.map(|joint| results.matrix(&joint.tally, Measure::Spacing)[0][task]);
        let panel = Panel {
            left: 75.0 + 330.0 * (task % COLUMNS) as f64,
            top: 75.0 + 300.0 * (task / COLUMNS) as f64,
            width: 240.0,
            height: 195.0,
            x: Axis::whole("stage", [1.0, tasks as f64]),
            y: Axis::from_zero(
                "spacing error, m²",
                curves.iter().flat_map(|(_, c)| c.iter().map(|p| p.1)).chain(joint),
            ),
        };
        panel.frame(&mut svg, &format!("task {}: {}", task + 1, plan.tasks[task].name));
        if let Some(joint) = joint {
            panel.curve(
                &mut svg,
                &[(1.0, joint), (tasks as f64, joint)],
                Stroke { width: 1.2, ..palette::model("joint") },
            );
        }
        for (name, curve) in &curves {
            panel.curve(&mut svg, curve, palette::model(name));
            for &point in curve {
                svg.dot(panel.at(point), palette::model(name).color);
            }
        }
    }
    let entries: Vec<_> =
        results.methods.iter().map(|l| (l.method.as_str().to_owned(), palette::model(l.method.as_str()))).collect();
    legend(&mut svg, (75.0, 30.0), &entries);
    svg.finish()
}

fn shortened(name: &str) -> String {
    let short: String = name.chars().take(10).collect();
    if short.len() < name.len() { short + "…" } else { short }
}
