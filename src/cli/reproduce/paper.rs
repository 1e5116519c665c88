//! The paper's figures (Continual Learning for Adaptable Car-Following, arXiv 2407.14247), on other events than ours.

use crate::consolidation::Method;
use crate::protocol::Measure;

/// Stage 1 / 2 / 3 of a task; none where the paper has no number.
pub(super) type Row = [Option<f64>; 3];

const NO: Option<f64> = None;

const fn last(value: f64) -> Row {
    [NO, NO, Some(value)]
}

const fn second(stage_2: f64, stage_3: f64) -> Row {
    [NO, Some(stage_2), Some(stage_3)]
}

const fn all(stage_1: f64, stage_2: f64, stage_3: f64) -> Row {
    [Some(stage_1), Some(stage_2), Some(stage_3)]
}

/// What the paper reports of this method and measure for the tasks fast, middle and slow; none for methods it has not.
pub(super) fn rows(method: Method, measure: Measure) -> Option<[Row; 3]> {
    Some(match (method, measure) {
        (Method::Joint, Measure::Spacing) => [last(22.64), last(88.90), last(136.77)],
        (Method::Joint, Measure::Speed) => [last(0.58), last(2.48), last(3.82)],
        (Method::Joint, Measure::Collisions) => [last(0.0), last(1.03), last(5.51)],
        (Method::Naive, Measure::Spacing) => [all(23.01, 47.78, 81.35), second(59.91, 117.46), last(112.70)],
        (Method::Naive, Measure::Speed) => [all(0.59, 1.22, 2.33), second(1.90, 3.27), last(3.31)],
        (Method::Naive, Measure::Collisions) => [all(0.19, 0.0, 0.0), second(0.65, 0.94), last(4.39)],
        (Method::Ewc, Measure::Spacing) => [all(3.01, 2.75, 8.02), second(3.18, 3.64), last(5.65)],
        (Method::Ewc, Measure::Speed) => [all(0.10, 0.10, 0.26), second(0.10, 0.11), last(0.23)],
        (Method::Ewc | Method::Mas, Measure::Collisions) => [all(0.0, 0.0, 0.0), second(0.0, 0.0), last(0.0)],
        (Method::Mas, Measure::Spacing) => [all(10.38, 11.30, 23.53), second(10.93, 8.09), last(7.48)],
        (Method::Mas, Measure::Speed) => [all(0.33, 0.35, 0.67), second(0.36, 0.26), last(0.24)],
        _ => return None,
    })
}
