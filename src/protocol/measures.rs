//! What a matrix of errors says about learning in turn.

use serde::Serialize;

/// Measures of R[i, j], the error on task j after stage i, T tasks in the order learned; lower is better.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measures {
    /// `(1/T) Σ_j R[T, j]`.
    pub average: f64,
    /// `R[T, j] − min_{i<T} R[i, j]` for j < T; none for a model of one stage.
    pub forgetting: Option<Vec<f64>>,
    /// `R[T, j] / R[j, j]` for j < T.
    pub forgetting_ratio: Option<Vec<f64>>,
    /// `1/(T−1) Σ_{j<T} (R[T, j] − R[j, j])`; positive is forgetting.
    pub backward_transfer: Option<f64>,
    /// `R[j, j] / naive's R[j, j]` for every j; none without `naive`.
    pub plasticity_loss: Option<Vec<f64>>,
    /// `1/(T−1) Σ_{j≥2} (R[j−1, j] − b_j)`, b being the error of the reference; none without one.
    pub forward_transfer: Option<f64>,
}

impl Measures {
    /// From R (stages × tasks), naive's R and a reference's error on each task.
    ///
    /// # Panics
    /// When R has no stage, or a matrix another number of tasks.
    #[must_use]
    pub fn of(r: &[Vec<f64>], naive: Option<&[Vec<f64>]>, reference: Option<&[f64]>) -> Self {
        let last = r.last().expect("a model has a stage");
        let tasks = last.len();
        let whole = r.len() == tasks && tasks > 1;
        let earlier = || 0..tasks - 1;
        let best_before = |j: usize| r[..tasks - 1].iter().map(|row| row[j]).fold(f64::INFINITY, f64::min);
        let mean = |sum: f64| sum / (tasks - 1) as f64;
        Self {
            average: last.iter().sum::<f64>() / tasks as f64,
            forgetting: whole.then(|| earlier().map(|j| last[j] - best_before(j)).collect()),
            forgetting_ratio: whole.then(|| earlier().map(|j| last[j] / r[j][j]).collect()),
            backward_transfer: whole.then(|| mean(earlier().map(|j| last[j] - r[j][j]).sum())),
            plasticity_loss: naive
                .filter(|naive| whole && naive.len() == tasks)
                .map(|naive| (0..tasks).map(|j| r[j][j] / naive[j][j]).collect()),
            forward_transfer: reference
                .filter(|_| whole)
                .map(|reference| mean((1..tasks).map(|j| r[j - 1][j] - reference[j]).sum())),
        }
    }
}

/// A mean over simulated steps from sums over events: `Σ w·sum / Σ w·steps`; none without steps.
#[must_use]
pub fn pooled(parts: impl Iterator<Item = (f64, f64, f64)>) -> Option<f64> {
    let (mut sum, mut steps) = (0.0, 0.0);
    for (weight, part, part_steps) in parts {
        sum += weight * part;
        steps += weight * part_steps;
    }
    (steps > 0.0).then(|| sum / steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measures_agree_with_a_case_by_hand() {
        let r = [vec![10.0, 30.0, 50.0], vec![12.0, 20.0, 40.0], vec![15.0, 18.0, 8.0]];
        let naive = [vec![10.0, 30.0, 50.0], vec![20.0, 16.0, 40.0], vec![30.0, 18.0, 5.0]];
        let measures = Measures::of(&r, Some(&naive), Some(&[20.0, 25.0, 30.0]));
        assert!((measures.average - 41.0 / 3.0).abs() < 1e-12);
        assert_eq!(measures.forgetting, Some(vec![5.0, -2.0]));
        assert_eq!(measures.forgetting_ratio, Some(vec![1.5, 0.9]));
        assert_eq!(measures.backward_transfer, Some(1.5));
        assert_eq!(measures.plasticity_loss, Some(vec![1.0, 1.25, 1.6]));
        // ((30 − 25) + (40 − 30)) / 2.
        assert_eq!(measures.forward_transfer, Some(7.5));
    }

    #[test]
    fn a_model_of_one_stage_has_an_average_alone() {
        let measures = Measures::of(&[vec![4.0, 8.0]], None, Some(&[1.0, 1.0]));
        assert_eq!(measures.average, 6.0);
        assert_eq!((measures.forgetting, measures.forward_transfer), (None, None));
    }

    #[test]
    fn means_are_pooled_over_steps_and_not_over_events() {
        assert_eq!(pooled([(1.0, 10.0, 1.0), (1.0, 0.0, 9.0)].into_iter()), Some(1.0));
        assert_eq!(pooled([(0.0, 10.0, 1.0), (2.0, 3.0, 3.0)].into_iter()), Some(1.0));
        assert_eq!(pooled(std::iter::empty()), None);
    }
}
