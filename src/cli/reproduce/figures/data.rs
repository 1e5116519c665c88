//! What is learned from: distributions of inputs and of mean speeds.

use super::palette;
use super::panel::{Axis, Panel, legend};
use super::svg::{Stroke, Svg};
use crate::car_following::Event;
use crate::cli::reproduce::plan::{Plan, Task};
use crate::protocol::quantile;

/// Bins of a density.
const BINS: usize = 60;
/// Standard deviation of the smoothing, bins.
const SMOOTHING_BINS: f64 = 1.5;
/// Share of the values at each end that a panel leaves out: a few outliers would hide the rest.
const TAIL: f64 = 0.002;

/// One value of an event's step.
type Feature = fn(&Event, usize) -> f64;

const FEATURES: [(&str, Feature); 4] = [
    ("follower speed, m/s", |event, t| event.follower_speed_mps()[t].into()),
    ("leader speed, m/s", |event, t| event.leader_speed_mps()[t].into()),
    ("relative speed, leader − follower, m/s", |event, t| {
        f64::from(event.leader_speed_mps()[t]) - f64::from(event.follower_speed_mps()[t])
    }),
    ("spacing, m", |event, t| event.spacing_m()[t].into()),
];

/// (a) Each input over the training events of each task: what a stage has learned from, and what comes next.
pub(super) fn shift(plan: &Plan) -> String {
    let mut svg = Svg::new(900.0, 640.0);
    for (place, (label, feature)) in FEATURES.into_iter().enumerate() {
        let values: Vec<Vec<f64>> = plan.tasks.iter().map(|task| of_all(&task.train, feature)).collect();
        let (low, high) = bulk(&values);
        let curves: Vec<_> = values.iter().map(|values| density(values, low, high)).collect();
        let panel = Panel {
            left: 75.0 + 440.0 * (place % 2) as f64,
            top: 75.0 + 285.0 * (place / 2) as f64,
            width: 350.0,
            height: 195.0,
            x: Axis::linear(label, [low, high]),
            y: Axis::from_zero("density", curves.iter().flatten().map(|point| point.1)),
        };
        panel.frame(&mut svg, "");
        for (task, curve) in curves.iter().enumerate() {
            panel.curve(&mut svg, curve, palette::task(task));
        }
    }
    legend(&mut svg, (75.0, 30.0), &entries(plan));
    svg.finish()
}

/// (b) Mean speeds of the events of each task.
pub(super) fn speeds(plan: &Plan) -> String {
    let mut svg = Svg::new(760.0, 360.0);
    let all = |task: &Task| {
        let sides = [&task.train, &task.validation, &task.test];
        sides.into_iter().flatten().map(Event::mean_speed_mps).collect::<Vec<_>>()
    };
    let values: Vec<Vec<f64>> = plan.tasks.iter().map(all).collect();
    let (low, high) = values.iter().flatten().fold((f64::INFINITY, 0.0_f64), |(l, h), &x| (l.min(x), h.max(x)));
    // In events per m/s, so that the areas of the tasks are their sizes.
    let curves: Vec<Vec<_>> = values
        .iter()
        .map(|values| density(values, low, high).into_iter().map(|(x, y)| (x, y * values.len() as f64)).collect())
        .collect();
    let panel = Panel {
        left: 75.0,
        top: 60.0,
        width: 650.0,
        height: 235.0,
        x: Axis::linear("mean follower speed of an event, m/s", [low, high]),
        y: Axis::from_zero("events per m/s", curves.iter().flatten().map(|point: &(f64, f64)| point.1)),
    };
    panel.frame(&mut svg, "");
    for (task, curve) in curves.iter().enumerate() {
        panel.curve(&mut svg, curve, palette::task(task));
    }
    legend(&mut svg, (75.0, 30.0), &entries(plan));
    svg.finish()
}

fn entries(plan: &Plan) -> Vec<(String, Stroke)> {
    plan.tasks.iter().enumerate().map(|(place, task)| (task.name.clone(), palette::task(place))).collect()
}

fn of_all(events: &[Event], feature: Feature) -> Vec<f64> {
    events.iter().flat_map(|event| (0..event.steps()).map(move |t| feature(event, t))).collect()
}

/// Where all but the outermost values lie.
fn bulk(values: &[Vec<f64>]) -> (f64, f64) {
    let mut all: Vec<f64> = values.iter().flatten().copied().collect();
    all.sort_by(f64::total_cmp);
    let (low, high) = (quantile(&all, TAIL), quantile(&all, 1.0 - TAIL));
    if high > low { (low, high) } else { (low - 0.5, low + 0.5) }
}

/// A histogram, smoothed by a Gaussian kernel; points of the curve.
fn density(values: &[f64], low: f64, high: f64) -> Vec<(f64, f64)> {
    let width = ((high - low) / BINS as f64).max(1e-9);
    let mut counts = [0.0; BINS];
    for value in values {
        let bin = ((value - low) / width).floor();
        if (0.0..=BINS as f64).contains(&bin) {
            counts[(bin as usize).min(BINS - 1)] += 1.0;
        }
    }
    let kernel = |distance: usize| (-0.5 * (distance as f64 / SMOOTHING_BINS).powi(2)).exp();
    let smooth = |bin: usize| {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (other, count) in counts.iter().enumerate() {
            let weight = kernel(bin.abs_diff(other));
            sum += weight * count;
            weights += weight;
        }
        sum / weights / (values.len().max(1) as f64 * width)
    };
    (0..BINS).map(|bin| (low + (bin as f64 + 0.5) * width, smooth(bin))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_density_has_area_one() {
        let values: Vec<f64> = (0..1000).map(|i| 2.0 + f64::from(i * 37 % 1000) / 250.0).collect();
        let curve = density(&values, 0.0, 8.0);
        let area: f64 = curve.iter().map(|(_, y)| y * 8.0 / BINS as f64).sum();
        assert!((area - 1.0).abs() < 1e-3, "{area}");
        let (x, y) = curve[30];
        assert!((x - 4.0666).abs() < 1e-3 && (y - 0.25).abs() < 0.01, "{x} {y}");
    }
}
