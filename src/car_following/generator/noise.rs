//! Random numbers keyed by what they are for.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A stream of random numbers that depends on its key alone.
///
/// Only IEEE arithmetic is used (no logarithm, no cosine), so that a key gives the same bits on every platform.
pub(super) struct Noise(ChaCha8Rng);

impl Noise {
    /// The stream of this key.
    pub(super) fn keyed(key: [u64; 4]) -> Self {
        let mut seed = [0; 32];
        for (bytes, word) in seed.chunks_exact_mut(8).zip(key) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        Self(ChaCha8Rng::from_seed(seed))
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [low, high).
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A whole number from low to high, both included.
    pub(super) fn whole(&mut self, low: usize, high: usize) -> usize {
        let choices = (high - low + 1) as u64;
        low + usize::try_from(self.0.next_u64() % choices).expect("less than a usize")
    }

    /// True with this probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Standard normal to good accuracy and within ±6: the sum of twelve uniform numbers (Irwin–Hall).
    pub(super) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }

    /// Normal with this mean and deviation, cut at two deviations: people differ, but not without bound.
    pub(super) fn person(&mut self, mean: f64, deviation: f64) -> f64 {
        mean + deviation * self.normal().clamp(-2.0, 2.0)
    }
}

/// An Ornstein–Uhlenbeck process in discrete time: mean 0, a given deviation, and a memory of `relaxation_s`.
pub(super) struct OrnsteinUhlenbeck {
    value: f64,
    keep: f64,
    kick: f64,
}

impl OrnsteinUhlenbeck {
    /// A process that starts in its stationary state.
    pub(super) fn new(deviation: f64, relaxation_s: f64, dt_s: f64, noise: &mut Noise) -> Self {
        let keep = 1.0 - dt_s / relaxation_s;
        Self { value: deviation * noise.normal(), keep, kick: deviation * (1.0 - keep * keep).sqrt() }
    }

    /// The next value.
    pub(super) fn next(&mut self, noise: &mut Noise) -> f64 {
        self.value = self.keep * self.value + self.kick * noise.normal();
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_zero_and_deviation_one() {
        let mut noise = Noise::keyed([1, 2, 3, 4]);
        let drawn: Vec<f64> = (0..20_000).map(|_| noise.normal()).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        let variance = drawn.iter().map(|x| x * x).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
    }

    #[test]
    fn the_process_keeps_its_deviation() {
        let mut noise = Noise::keyed([5, 0, 0, 0]);
        let mut process = OrnsteinUhlenbeck::new(0.3, 2.0, 0.1, &mut noise);
        let variance = (0..40_000).map(|_| process.next(&mut noise).powi(2)).sum::<f64>() / 40_000.0;
        assert!((variance.sqrt() - 0.3).abs() < 0.03, "{variance}");
    }

    #[test]
    fn each_word_of_the_key_matters() {
        let first = |key| Noise::keyed(key).unit().to_bits();
        let all = [[0; 4], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]].map(first);
        for (i, a) in all.iter().enumerate() {
            assert!(!all[i + 1..].contains(a));
        }
    }
}
