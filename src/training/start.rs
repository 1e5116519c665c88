//! Where in an event an update begins to drive.

use rand_chacha::rand_core::Rng;

use super::order::keyed;
use crate::car_following::Event;

/// `events` from a random step on: none of them loses more than `share` of the steps that would be simulated, and each
/// keeps its end. What comes before a simulation is recorded, so an event that begins anywhere teaches to go on from there;
/// the same events say more. Keyed by (seed, stage, update) and the place in the minibatch.
pub(super) fn late(
    events: &[&Event],
    share: f64,
    horizon: usize,
    (seed, stage, update): (u64, u32, u64),
) -> Vec<Event> {
    let mut random = keyed("start", seed, stage, u32::try_from(update).unwrap_or(u32::MAX));
    let each = |event: &&Event| {
        let most = (share * (event.steps() - horizon) as f64) as usize;
        // One number an event, whatever its length.
        let from = (u128::from(random.next_u64()) * (most as u128 + 1)) >> 64;
        event.after(from as usize)
    };
    events.iter().map(each).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_are_spread_keep_the_end_and_depend_on_their_key_alone() {
        let spacing: Vec<f32> = (0..110).map(|t| t as f32).collect();
        let event = Event::new(0.1, spacing, vec![1.0; 110], vec![1.0; 110]);
        let events = vec![&event; 200];
        let late = |update| late(&events, 0.5, 10, (42, 1, update));
        let first: Vec<_> = late(1).iter().map(|event| event.spacing_m()[0] as usize).collect();
        assert!(first.iter().all(|&from| from <= 50) && first.contains(&0) && first.contains(&50));
        assert!(late(1).iter().all(|event| event.spacing_m().last() == Some(&109.0)));
        assert_eq!(late(1), late(1));
        assert_ne!(late(1), late(2));
    }
}
