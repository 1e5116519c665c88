//! Synaptic intelligence: importance gathered along the way of a stage.

/// How much each weight's way through a stage lowered the loss.
///
/// `ω_i = Σ_updates −g_i Δθ_i`, g being the gradient of the loss of driving alone, unclipped and without the penalty, on the
/// update's minibatch, and Δθ what the update did to the weight in the end. Then `Ω_i = max(0, ω_i / ((θ_i − θ⁰_i)² + ξ))`,
/// θ⁰ being the weights before the stage (Zenke, Poole & Ganguli 2017); the penalty is `λ Σ Ω (θ − θ*)²`, without a ½.
/// Each minibatch's own gradient decides about its own step, so ω is greater than the fall of the loss, where gradients
/// are noisy by much (Benzing 2022).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PathIntegral(Vec<f32>);

impl PathIntegral {
    /// Of no update yet.
    #[must_use]
    pub fn new(parameters: usize) -> Self {
        Self(vec![0.0; parameters])
    }

    /// As it was saved.
    #[must_use]
    pub fn resumed(sums: Vec<f32>) -> Self {
        Self(sums)
    }

    /// ω so far, for a checkpoint.
    #[must_use]
    pub fn sums(&self) -> &[f32] {
        &self.0
    }

    /// Adds one update that led from `before` to `after`.
    pub fn add(&mut self, gradient: &[f32], before: &[f32], after: &[f32]) {
        for (((sum, g), from), to) in self.0.iter_mut().zip(gradient).zip(before).zip(after) {
            *sum -= g * (to - from);
        }
    }

    /// Ω of a stage that led from `first` to `last`, with the damping ξ.
    #[must_use]
    pub fn importance(&self, first: &[f32], last: &[f32], damping: f64) -> Vec<f64> {
        let each = self.0.iter().zip(first).zip(last);
        each.map(|((sum, from), to)| (f64::from(*sum) / (f64::from(to - from).powi(2) + damping)).max(0.0)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_a_quadratic_the_way_adds_up_to_the_fall_of_the_loss() {
        // L = ½ Σ a θ²: small steps of descent, whose ω is what each weight's own term fell by.
        let stiffness = [1.0_f32, 10.0, 0.0];
        let first = [1.0_f32, -0.5, 2.0];
        let (mut weights, mut path) = (first, PathIntegral::new(3));
        for _ in 0..20_000 {
            let gradient: [f32; 3] = std::array::from_fn(|i| stiffness[i] * weights[i]);
            let after: [f32; 3] = std::array::from_fn(|i| weights[i] - 1e-4 * gradient[i]);
            path.add(&gradient, &weights, &after);
            weights = after;
        }
        for i in 0..3 {
            let fall = 0.5 * stiffness[i] * (first[i] * first[i] - weights[i] * weights[i]);
            assert!((path.sums()[i] - fall).abs() < 2e-3 * (1.0 + fall), "weight {i}: {} of {fall}", path.sums()[i]);
        }
        let importance = path.importance(&first, &weights, 1e-3);
        // Half the stiffness of a weight that came all the way; none of the one that never moved.
        assert!((importance[1] - 5.0).abs() < 0.1 && importance[2] == 0.0, "{importance:?}");
    }

    #[test]
    fn what_raised_the_loss_counts_nothing() {
        let mut path = PathIntegral::new(2);
        path.add(&[1.0, 1.0], &[0.0, 0.0], &[0.5, -0.5]);
        assert_eq!(path.importance(&[0.0, 0.0], &[0.5, -0.5], 0.25), [0.0, 1.0]);
    }
}
