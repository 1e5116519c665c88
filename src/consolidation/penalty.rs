//! The penalty once, for every method: a diagonal quadratic that any number of anchors collapses to.

use super::accumulation::Accumulate;
use super::{Method, RegimeMemory};

/// `½ Σ A_i (θ_i − μ_i)² + rest`, which equals the sum of the separate penalties exactly.
///
/// EWC's penalty is `½ Σ_k F_k (θ − θ*_k)²`, MAS's and SI's `Σ_k Ω_k (θ − θ*_k)²` (they have no ½), both summed over weights
/// too, so with w = 1 or 2 and the regime's share `d_k` of the accumulation, which is 1 but for `online`: `A = w Σ_k d_k I_k`,
/// `A μ = w Σ_k d_k I_k θ*_k`, `rest = ½ Σ (w Σ_k d_k I_k θ*_k² − A μ²)`. O(P) for any number of regimes. λ is not part of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Penalty {
    stiffness: Vec<f32>,
    center: Vec<f32>,
    rest: f64,
    /// `Σ d_k`.
    regimes: f64,
}

impl Penalty {
    /// Collapses what is kept of the regimes; `latest` are the weights before the stage. `None` when nothing is kept, or the
    /// method holds on to nothing.
    #[must_use]
    pub fn collapse(method: Method, accumulate: Accumulate, memory: &[RegimeMemory], latest: &[f32]) -> Option<Self> {
        if memory.is_empty() || !method.consolidates() {
            return None;
        }
        let weight = method.penalty_factor();
        let shares = accumulate.shares(memory);
        let parameters = latest.len();
        let (mut stiffness, mut center) = (Vec::with_capacity(parameters), Vec::with_capacity(parameters));
        let mut rest = 0.0;
        for i in 0..parameters {
            let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
            for (kept, share) in memory.iter().zip(&shares) {
                let importance = weight * share * f64::from(kept.importance[i]);
                let anchor = f64::from(if accumulate.keeps_anchors() { kept.anchor[i] } else { latest[i] });
                a += importance;
                b += importance * anchor;
                c += importance * anchor * anchor;
            }
            // A weight that never mattered has no center of its own.
            let mu = if a > 0.0 { b / a } else { f64::from(latest[i]) };
            rest += 0.5 * (c - a * mu * mu).max(0.0);
            stiffness.push(a as f32);
            center.push(mu as f32);
        }
        Some(Self { stiffness, center, rest, regimes: shares.iter().sum() })
    }

    /// Median of A over the weights that matter at all, per regime kept: the scale that `strength` is measured against.
    #[must_use]
    pub fn typical_stiffness(&self) -> f64 {
        let mut positive: Vec<f32> = self.stiffness.iter().copied().filter(|&a| a > 0.0).collect();
        if positive.is_empty() {
            return 0.0;
        }
        let middle = positive.len() / 2;
        let (_, &mut median, _) = positive.select_nth_unstable_by(middle, f32::total_cmp);
        f64::from(median) / self.regimes
    }

    /// Its value at `weights`, for λ = 1.
    #[must_use]
    pub fn value(&self, weights: &[f32]) -> f64 {
        let mut sum = 0.0;
        for ((a, mu), w) in self.stiffness.iter().zip(&self.center).zip(weights) {
            let off = f64::from(*w) - f64::from(*mu);
            sum += f64::from(*a) * off * off;
        }
        0.5 * sum + self.rest
    }

    /// Adds `λ A (θ − μ)` to `gradient`: the coupled step.
    pub fn add_gradient(&self, lambda: f32, weights: &[f32], gradient: &mut [f32]) {
        let each = self.stiffness.iter().zip(&self.center);
        for (((a, mu), w), g) in each.zip(weights).zip(gradient) {
            *g += lambda * a * (w - mu);
        }
    }

    /// `θ ← (θ' + η A μ) / (1 + η A) = μ + (θ' − μ) / (1 + η A)` with η = lr · λ: the proximal step, stable for every η.
    pub fn pull(&self, eta: f64, weights: &mut [f32]) {
        let each = self.stiffness.iter().zip(&self.center);
        for ((a, mu), w) in each.zip(weights) {
            let stay = 1.0 / (1.0 + eta * f64::from(*a));
            *w = (f64::from(*mu) + (f64::from(*w) - f64::from(*mu)) * stay) as f32;
        }
    }

    /// `θ ← θ + (θ' − θ) / (1 + η A)` with η = lr · λ, `before` being θ and `weights` the optimiser's θ': the modulated step. It
    /// slows what matters and never pulls it back.
    pub fn modulate(&self, eta: f64, before: &[f32], weights: &mut [f32]) {
        for ((a, from), w) in self.stiffness.iter().zip(before).zip(weights) {
            let factor = 1.0 / (1.0 + eta * f64::from(*a));
            *w = (f64::from(*from) + (f64::from(*w) - f64::from(*from)) * factor) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Accumulation;
    use super::*;
    use proptest::array::{uniform2, uniform3};
    use proptest::prelude::*;

    const SEPARATE: Accumulate = Accumulate { rule: Accumulation::Separate, decay: 1.0 };

    fn memory(importance: &[f32], anchor: &[f32]) -> RegimeMemory {
        RegimeMemory {
            regime: String::new(),
            importance: importance.to_vec(),
            anchor: anchor.to_vec(),
            samples: 1,
            stage: 1,
        }
    }

    proptest! {
        #[test]
        fn the_collapse_equals_the_sum_of_separate_penalties(
            kept in proptest::collection::vec((uniform3(0.0_f32..10.0), uniform3(-2.0_f32..2.0)), 1..6),
            weights in uniform3(-3.0_f32..3.0),
        ) {
            let kept: Vec<_> = kept.iter().map(|(importance, anchor)| memory(importance, anchor)).collect();
            for (method, factor) in [(Method::Ewc, 0.5), (Method::Mas, 1.0)] {
                let apart: f64 = kept.iter().flat_map(|k| (0..3).map(move |i| {
                    factor * f64::from(k.importance[i]) * (f64::from(weights[i]) - f64::from(k.anchor[i])).powi(2)
                })).sum();
                let together = Penalty::collapse(method, SEPARATE, &kept, &[0.0; 3]).unwrap();
                prop_assert!((together.value(&weights) - apart).abs() <= 1e-4 * (1.0 + apart));
            }
        }

        #[test]
        fn the_gradient_is_the_derivative_of_the_value(weights in uniform2(-3.0_f32..3.0)) {
            let kept = [memory(&[1.0, 0.5], &[0.3, -1.0]), memory(&[0.2, 2.0], &[1.0, 1.0])];
            let penalty = Penalty::collapse(Method::Mas, SEPARATE, &kept, &[0.0; 2]).unwrap();
            let mut gradient = vec![0.0; 2];
            penalty.add_gradient(3.0, &weights, &mut gradient);
            for i in 0..2 {
                let (mut up, mut down) = (weights, weights);
                up[i] += 0.01;
                down[i] -= 0.01;
                let central = 3.0 * (penalty.value(&up) - penalty.value(&down)) / (f64::from(up[i]) - f64::from(down[i]));
                prop_assert!((central - f64::from(gradient[i])).abs() < 1e-3 * (1.0 + central.abs()));
            }
        }

        #[test]
        fn the_pull_is_stable_for_every_strength(exponent in -6..=12_i32, weight in -3.0_f32..3.0) {
            let penalty = Penalty::collapse(Method::Ewc, SEPARATE, &[memory(&[2.0], &[1.0])], &[0.0]).unwrap();
            let mut weights = [weight];
            penalty.pull(10.0_f64.powi(exponent), &mut weights);
            let (low, high) = (weight.min(1.0), weight.max(1.0));
            prop_assert!((low..=high).contains(&weights[0]));
        }
    }

    #[test]
    fn sum_latest_anchors_everything_at_the_latest_weights() {
        let kept = [memory(&[1.0], &[5.0]), memory(&[3.0], &[7.0])];
        let penalty =
            Penalty::collapse(Method::Ewc, Accumulate { rule: Accumulation::SumLatest, ..SEPARATE }, &kept, &[2.0])
                .unwrap();
        assert_eq!(penalty.value(&[2.0]), 0.0);
        assert_eq!(penalty.value(&[3.0]), 2.0);
    }

    #[test]
    fn online_halves_the_older_regime_with_a_decay_of_a_half_and_anchors_at_the_latest_weights() {
        let online = Accumulate { rule: Accumulation::Online, decay: 0.5 };
        let older = memory(&[8.0], &[5.0]);
        let newer = RegimeMemory { stage: 2, ..memory(&[2.0], &[7.0]) };
        let penalty = Penalty::collapse(Method::Ewc, online, &[older, newer], &[3.0]).unwrap();
        // γ (γ 8 + 2) = 3
        assert_eq!((penalty.value(&[3.0]), penalty.value(&[5.0])), (0.0, 6.0));
    }

    #[test]
    fn the_modulated_step_slows_what_matters_and_pulls_nothing_back() {
        let penalty =
            Penalty::collapse(Method::Ewc, SEPARATE, &[memory(&[0.0, 1.0, 3.0], &[9.0; 3])], &[0.0; 3]).unwrap();
        let mut weights = [1.0, 1.0, -1.0];
        penalty.modulate(1.0, &[0.0; 3], &mut weights);
        assert_eq!(weights, [1.0, 0.5, -0.25]);
        penalty.modulate(1e12, &weights.clone(), &mut weights);
        assert_eq!(weights, [1.0, 0.5, -0.25], "where nothing moves, nothing is pulled");
    }

    #[test]
    fn nothing_kept_and_methods_that_hold_on_to_nothing_have_no_penalty() {
        let kept = [memory(&[1.0], &[1.0])];
        for method in [Method::Naive, Method::Joint, Method::Replay] {
            assert!(Penalty::collapse(method, SEPARATE, &kept, &[0.0]).is_none());
        }
        assert!(Penalty::collapse(Method::Ewc, SEPARATE, &[], &[0.0]).is_none());
    }
}
