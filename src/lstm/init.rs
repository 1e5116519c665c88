//! Weights before the first update.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::Layout;

/// As `FollowNet`'s LSTM begins: every LSTM parameter uniform within ±1/√hidden (torch's default; the bias is the sum of
/// torch's two), head weights normal with deviation 0.02, head bias 0.
#[must_use]
pub fn initial_weights(layout: Layout, seed: u64) -> Vec<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = move || (random.next_u32() >> 8) as f32 / (1_u32 << 24) as f32;
    let bound = 1.0 / (layout.hidden as f32).sqrt();
    let mut weights = vec![0.0; layout.len()];
    for w in &mut weights[..layout.bias().start] {
        *w = bound * (2.0 * unit() - 1.0);
    }
    for w in &mut weights[layout.bias()] {
        *w = bound * (2.0 * unit() - 1.0) + bound * (2.0 * unit() - 1.0);
    }
    for w in &mut weights[layout.head()] {
        // Box–Muller; 1 − u keeps the logarithm finite.
        let radius = (-2.0 * (1.0 - unit()).ln()).sqrt();
        *w = 0.02 * radius * (std::f32::consts::TAU * unit()).cos();
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lstm::INPUTS;

    #[test]
    fn weights_follow_their_distributions_and_their_seed() {
        let layout = Layout { hidden: 128, inputs: INPUTS };
        let weights = initial_weights(layout, 42);
        let bound = 1.0 / 128.0_f32.sqrt();
        assert!(weights[..layout.bias().start].iter().all(|w| w.abs() <= bound));
        let head = &weights[layout.head()];
        let deviation = (head.iter().map(|w| w * w).sum::<f32>() / head.len() as f32).sqrt();
        assert!((0.015..0.025).contains(&deviation), "{deviation}");
        assert_eq!(weights[layout.head_bias()], 0.0);
        assert_eq!(weights, initial_weights(layout, 42));
        assert_ne!(weights, initial_weights(layout, 43));
    }
}
