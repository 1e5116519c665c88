//! In which order events are seen: by content first, so that ids and arrival never matter, then shuffled by key.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sha2::{Digest, Sha256};

use crate::car_following::Event;

/// Indices of `events` in the order of their digests, without those no longer than the horizon.
pub(super) fn by_content(events: &[Event], horizon: usize) -> Vec<usize> {
    let mut order: Vec<_> = events
        .iter()
        .enumerate()
        .filter(|(_, event)| event.steps() > horizon)
        .map(|(index, event)| (event.content_sha256(), index))
        .collect();
    order.sort_unstable();
    order.into_iter().map(|(_, index)| index).collect()
}

/// A generator of its own for each purpose: keyed by (seed, stage, epoch), never by time or thread.
pub(super) fn keyed(purpose: &str, seed: u64, stage: u32, epoch: u32) -> ChaCha8Rng {
    let mut hasher = Sha256::new();
    hasher.update(purpose);
    hasher.update(seed.to_le_bytes());
    hasher.update(stage.to_le_bytes());
    hasher.update(epoch.to_le_bytes());
    ChaCha8Rng::from_seed(hasher.finalize().into())
}

/// Fisher–Yates.
pub(super) fn shuffle<X>(items: &mut [X], random: &mut ChaCha8Rng) {
    for last in (1..items.len()).rev() {
        // The high half of a 64 × 64 bit product is uniform to within 2⁻⁶⁴ · last.
        let pick = (u128::from(random.next_u64()) * (last as u128 + 1)) >> 64;
        items.swap(last, pick as usize);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shuffle_is_a_permutation_that_depends_on_its_key_alone() {
        let shuffled = |seed, stage, epoch| {
            let mut items: Vec<_> = (0..100).collect();
            shuffle(&mut items, &mut keyed("order", seed, stage, epoch));
            items
        };
        let mut sorted = shuffled(1, 1, 1);
        sorted.sort_unstable();
        assert_eq!(sorted, (0..100).collect::<Vec<_>>());
        assert_eq!(shuffled(1, 1, 1), shuffled(1, 1, 1));
        for other in [shuffled(2, 1, 1), shuffled(1, 2, 1), shuffled(1, 1, 2)] {
            assert_ne!(other, shuffled(1, 1, 1));
        }
    }
}
