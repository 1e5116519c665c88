//! One leader–follower trajectory.

use sha2::{Digest, Sha256};

/// A checked event: one leader–follower pair over consecutive steps of `dt_s`.
///
/// The three arrays have equal length and hold finite values; speeds are ≥ 0 and spacing > 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    dt_s: f64,
    spacing_m: Vec<f32>,
    follower_speed_mps: Vec<f32>,
    leader_speed_mps: Vec<f32>,
}

impl Event {
    /// An event of arrays that were checked where they came in.
    ///
    /// # Panics
    /// When the arrays differ in length.
    #[must_use]
    pub fn new(dt_s: f64, spacing_m: Vec<f32>, follower_speed_mps: Vec<f32>, leader_speed_mps: Vec<f32>) -> Self {
        assert!(
            spacing_m.len() == follower_speed_mps.len() && spacing_m.len() == leader_speed_mps.len(),
            "the arrays of an event have equal length"
        );
        Self { dt_s, spacing_m, follower_speed_mps, leader_speed_mps }
    }

    /// Seconds between steps.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        self.dt_s
    }

    /// Number of steps.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.spacing_m.len()
    }

    /// Bumper-to-bumper spacing, m.
    #[must_use]
    pub fn spacing_m(&self) -> &[f32] {
        &self.spacing_m
    }

    /// Follower speed, m/s.
    #[must_use]
    pub fn follower_speed_mps(&self) -> &[f32] {
        &self.follower_speed_mps
    }

    /// Leader speed, m/s.
    #[must_use]
    pub fn leader_speed_mps(&self) -> &[f32] {
        &self.leader_speed_mps
    }

    /// What is left of the event from step `from` on.
    ///
    /// # Panics
    /// When the event has fewer steps.
    #[must_use]
    pub fn after(&self, from: usize) -> Self {
        let cut = |values: &[f32]| values[from..].to_vec();
        Self {
            dt_s: self.dt_s,
            spacing_m: cut(&self.spacing_m),
            follower_speed_mps: cut(&self.follower_speed_mps),
            leader_speed_mps: cut(&self.leader_speed_mps),
        }
    }

    /// Mean follower speed over all steps, m/s.
    #[must_use]
    pub fn mean_speed_mps(&self) -> f64 {
        let sum: f64 = self.follower_speed_mps.iter().map(|&v| f64::from(v)).sum();
        sum / self.steps().max(1) as f64
    }

    /// The arrays as stored: spacing, follower speed, leader speed, little-endian f32, one after another.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        // An array at a time: so each is one copy, where byte by byte is dozens of times slower.
        let mut stored = Vec::with_capacity(3 * self.steps());
        for values in [&self.spacing_m, &self.follower_speed_mps, &self.leader_speed_mps] {
            stored.extend(values.iter().map(|x| x.to_le_bytes()));
        }
        stored.into_flattened()
    }

    /// The event whose [`Self::to_bytes`] these are; `None` when the length does not fit.
    #[must_use]
    pub fn from_bytes(dt_s: f64, bytes: &[u8]) -> Option<Self> {
        if !bytes.len().is_multiple_of(12) {
            return None;
        }
        let (values, _) = bytes.as_chunks::<4>();
        let steps = values.len() / 3;
        let array = |n: usize| values[n * steps..][..steps].iter().map(|b| f32::from_le_bytes(*b)).collect();
        Some(Self::new(dt_s, array(0), array(1), array(2)))
    }

    /// Digest of the content: SHA-256 over `dt_s` (f64, little-endian) and [`Self::to_bytes`]. Copies have equal digests.
    #[must_use]
    pub fn content_sha256(&self) -> [u8; 32] {
        Self::digest_of(self.dt_s, &self.to_bytes())
    }

    /// [`Self::content_sha256`] of the event whose [`Self::to_bytes`] these are.
    #[must_use]
    pub fn digest_of(dt_s: f64, bytes: &[u8]) -> [u8; 32] {
        let mut hasher = Sha256::new();
        hasher.update(dt_s.to_le_bytes());
        hasher.update(bytes);
        hasher.finalize().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_round_trip_and_digest_tells_content() {
        let event = Event::new(0.1, vec![20.0, 20.1], vec![5.0, 5.0], vec![6.0, 6.0]);
        assert_eq!(Event::from_bytes(0.1, &event.to_bytes()), Some(event.clone()));
        assert_eq!(Event::from_bytes(0.1, &[0; 13]), None);
        let slower = Event::from_bytes(0.2, &event.to_bytes()).unwrap();
        assert_ne!(event.content_sha256(), slower.content_sha256());
    }
}
