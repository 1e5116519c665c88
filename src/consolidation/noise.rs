//! Random seeds for backward passes, keyed by content: the same whatever the batches, the order and the threads.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sha2::{Digest, Sha256};

use crate::car_following::Event;

/// A counter-based generator of its own for each event and draw.
pub(super) struct Noise(ChaCha8Rng);

impl Noise {
    /// The generator of an event's `draw`.
    pub(super) fn keyed(event: &Event, draw: u32) -> Self {
        let mut hasher = Sha256::new();
        hasher.update("importance");
        hasher.update(event.content_sha256());
        hasher.update(draw.to_le_bytes());
        Self(ChaCha8Rng::from_seed(hasher.finalize().into()))
    }

    /// Uniform within (0, 1), both ends excluded.
    fn uniform(&mut self) -> f64 {
        // The middle of one of 2⁵² cells.
        ((self.0.next_u64() >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
    }

    /// Standard normal (Box & Muller 1958).
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// Standard Cauchy.
    pub(super) fn cauchy(&mut self) -> f64 {
        (std::f64::consts::PI * (self.uniform() - 0.5)).tan()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(spacing_m: f32) -> Event {
        Event::new(0.1, vec![spacing_m; 3], vec![5.0; 3], vec![5.0; 3])
    }

    #[test]
    fn the_moments_of_the_normal_are_a_normals() {
        let mut noise = Noise::keyed(&event(9.0), 0);
        let drawn: Vec<_> = (0..100_000).map(|_| noise.normal()).collect();
        let moment = |power| drawn.iter().map(|x| x.powi(power)).sum::<f64>() / drawn.len() as f64;
        assert!(moment(1).abs() < 0.02 && (moment(2) - 1.0).abs() < 0.02 && (moment(4) - 3.0).abs() < 0.2);
    }

    #[test]
    fn half_of_the_cauchy_lies_within_one() {
        let mut noise = Noise::keyed(&event(9.0), 0);
        let within = (0..100_000).filter(|_| noise.cauchy().abs() < 1.0).count();
        assert!((within as f64 / 100_000.0 - 0.5).abs() < 0.01, "{within}");
    }

    #[test]
    fn every_event_and_draw_has_its_own() {
        let first = |spacing, draw| Noise::keyed(&event(spacing), draw).normal();
        assert_eq!(first(9.0, 0), first(9.0, 0));
        assert_ne!(first(9.0, 0), first(9.0, 1));
        assert_ne!(first(9.0, 0), first(8.0, 0));
    }
}
