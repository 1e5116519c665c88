//! The figures, as SVG files.

/// What is learned from.
mod data;
/// One event of each task, driven.
mod drives;
/// Errors over stages.
mod matrices;
/// Colours.
mod palette;
/// Axes and curves.
mod panel;
/// The file format.
mod svg;
/// Old traffic against new.
mod trade_offs;

use super::results::Results;
use super::sweep::Sweep;
use super::work::Work;

/// A figure, and what it shows in a sentence.
pub(super) struct Figure {
    pub(super) file: &'static str,
    pub(super) caption: &'static str,
    pub(super) svg: String,
}

/// All of them.
pub(super) fn figures(work: &Work<'_>, results: &Results, sweeps: &[Sweep]) -> Vec<Figure> {
    let plan = work.plan;
    let figure = |file, caption, svg| Figure { file, caption, svg };
    let mut figures = vec![
        figure(
            "shift.svg",
            "Distributional shift: each input over the training events of each task.",
            data::shift(plan),
        ),
        figure("speeds.svg", "Mean follower speeds of the events of each task.", data::speeds(plan)),
        figure(
            "stages.svg",
            "Error after each stage on each task; in parentheses where a task is not learned yet.",
            matrices::heat_maps(plan, results),
        ),
        figure(
            "forgetting.svg",
            "Error on each task from the stage that learned it on; the line across is `joint`.",
            matrices::forgetting(plan, results),
        ),
        figure(
            "trajectories.svg",
            "The test event of median error of each task: recorded, each method after its last stage, the IDM.",
            drives::trajectories(work, results),
        ),
    ];
    if !sweeps.is_empty() {
        figures.push(figure(
            "lambda.svg",
            "Old traffic against new over λ, after stage 2, one seed.",
            trade_offs::over_lambda(plan, sweeps),
        ));
    }
    figures.push(figure(
        "updates.svg",
        "Error on some test events over the updates of a stage, one seed: the stability gap.",
        trade_offs::over_updates(plan, results),
    ));
    figures
}
