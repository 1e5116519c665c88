//! One test event of each task, driven by everybody.

use super::palette;
use super::panel::{Axis, Panel, legend};
use super::svg::{Stroke, Svg};
use crate::car_following::Event;
use crate::cli::reproduce::results::Results;
use crate::cli::reproduce::work::Work;
use crate::evaluation::drive_events;
use crate::safety::Trajectory;

/// What somebody makes of an event.
struct Curve {
    name: String,
    spacing_m: Vec<f64>,
    speed_mps: Vec<f64>,
}

/// (d) Spacing and speed over time: recorded, each method after its last stage (first seed), the IDM. The event of a task is
/// the one whose error is the median of the first method's, so that it is neither the best nor the worst.
pub(super) fn trajectories(work: &Work<'_>, results: &Results) -> String {
    let plan = work.plan;
    let rows = plan.tasks.len();
    let mut svg = Svg::new(940.0, 65.0 + 265.0 * rows as f64);
    let mut entries = Vec::new();
    for (row, task) in plan.tasks.iter().enumerate() {
        let median = median_event(results, row);
        let event = &task.test[median];
        let curves = curves(work, results, row, event);
        let horizon = work.options.settings.horizon as usize;
        let time = |t: usize| t as f64 * event.dt_s();
        for (column, label) in ["spacing, m", "follower speed, m/s"].into_iter().enumerate() {
            let values = |curve: &'_ Curve| if column == 0 { curve.spacing_m.clone() } else { curve.speed_mps.clone() };
            let panel = Panel {
                left: 75.0 + 460.0 * column as f64,
                top: 75.0 + 265.0 * row as f64,
                width: 370.0,
                height: 165.0,
                x: Axis::from_zero("time, s", [time(event.steps() - 1)]),
                y: Axis::linear(label, curves.iter().flat_map(values)),
            };
            panel.frame(&mut svg, &format!("{}: {}", task.name, task.test_ids[median]));
            for curve in &curves {
                // The window is recorded: nobody drives in it.
                let from = if curve.name == "recorded" { 0 } else { horizon - 1 };
                let points: Vec<_> =
                    values(curve).into_iter().enumerate().skip(from).map(|(t, value)| (time(t), value)).collect();
                let stroke = palette::model(&curve.name);
                let width = if curve.name == "recorded" { 2.6 } else { 1.6 };
                panel.curve(&mut svg, &points, Stroke { width, ..stroke });
            }
        }
        entries = curves.iter().map(|curve| (curve.name.clone(), palette::model(&curve.name))).collect();
    }
    legend(&mut svg, (75.0, 30.0), &entries);
    svg.finish()
}

fn median_event(results: &Results, task: usize) -> usize {
    let last = results.methods[0].seeds[0].last().expect("a method has a stage");
    let errors = &last.measured.alone[task];
    let mut order: Vec<usize> = (0..errors.len()).collect();
    order.sort_by(|&a, &b| errors[a].spacing_sq.total_cmp(&errors[b].spacing_sq));
    order[order.len() / 2]
}

fn curves(work: &Work<'_>, results: &Results, task: usize, event: &Event) -> Vec<Curve> {
    let wide = |values: &[f32]| values.iter().map(|&x| f64::from(x)).collect();
    let recorded = Curve {
        name: "recorded".to_owned(),
        spacing_m: wide(event.spacing_m()),
        speed_mps: wide(event.follower_speed_mps()),
    };
    let driven = |name: &str, driven: &Trajectory| Curve {
        name: name.to_owned(),
        spacing_m: wide(&driven.spacing_m),
        speed_mps: wide(&driven.follower_speed_mps),
    };
    let methods = results.methods.iter().map(|learnt| {
        let last = &learnt.seeds[0].last().expect("a method has a stage").learned;
        let events = std::slice::from_ref(event);
        let drives =
            drive_events(work.options.settings.shape(), &last.scaling, &last.weights, None, events, &work.workers);
        driven(learnt.method.as_str(), &drives[0])
    });
    let idm = results.reference("idm").map(|idm| {
        let horizon = work.options.settings.horizon as usize;
        driven("idm", &idm.drivers[task].drive(event, horizon).into())
    });
    [recorded].into_iter().chain(methods).chain(idm).collect()
}
