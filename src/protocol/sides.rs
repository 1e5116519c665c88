//! Which events of a task are for training, validation and test.

use sha2::{Digest, Sha256};

use crate::lineage::Split;

/// 70 % of each task for training, 15 % for validation, 15 % for test, at random: the events of a task in the order of
/// SHA-256(seed, content), of n the first ⌊0.7 n⌋ and up to ⌊0.85 n⌋. The order of the files does not matter.
#[must_use]
pub fn at_random(task_of: &[usize], content: &[[u8; 32]], seed: u64) -> Vec<Split> {
    let draw = |event: usize| -> [u8; 32] {
        let mut hasher = Sha256::new();
        hasher.update(b"side");
        hasher.update(seed.to_le_bytes());
        hasher.update(content[event]);
        hasher.finalize().into()
    };
    let mut sides = vec![Split::Train; task_of.len()];
    for task in 0..task_of.iter().max().map_or(0, |last| last + 1) {
        let mut events: Vec<_> = (0..task_of.len()).filter(|&event| task_of[event] == task).collect();
        events.sort_by_cached_key(|&event| draw(event));
        let (trained, validated) = (events.len() * 70 / 100, events.len() * 85 / 100);
        for (place, event) in events.into_iter().enumerate() {
            if place >= validated {
                sides[event] = Split::Test;
            } else if place >= trained {
                sides[event] = Split::Validation;
            }
        }
    }
    sides
}

/// The first task that cannot be learned or tested, and which side it lacks; validation events may be missing.
#[must_use]
pub fn missing_side(tasks: usize, task_of: &[usize], sides: &[Split]) -> Option<(usize, Split)> {
    (0..tasks).find_map(|task| {
        let has = |side| task_of.iter().zip(sides).any(|(&of, &on)| of == task && on == side);
        [Split::Train, Split::Test].into_iter().find(|&side| !has(side)).map(|side| (task, side))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contents(count: usize) -> Vec<[u8; 32]> {
        (0..count).map(|i| Sha256::digest(i.to_le_bytes()).into()).collect()
    }

    #[test]
    fn each_task_is_split_seventy_fifteen_fifteen_whatever_the_order_of_the_files() {
        let task_of: Vec<_> = (0..2914).map(|event| event % 2).collect();
        let content = contents(task_of.len());
        let sides = at_random(&task_of, &content, 0);
        for task in 0..2 {
            let count = |side| (0..2914).filter(|&event| task_of[event] == task && sides[event] == side).count();
            assert_eq!([count(Split::Train), count(Split::Validation), count(Split::Test)], [1019, 219, 219]);
        }
        let turned: Vec<_> = content.iter().rev().copied().collect();
        let mut of_turned = at_random(&task_of.iter().rev().copied().collect::<Vec<_>>(), &turned, 0);
        of_turned.reverse();
        assert_eq!(of_turned, sides);
        assert_ne!(at_random(&task_of, &content, 1), sides);
    }

    #[test]
    fn a_task_of_one_event_lacks_a_side() {
        let sides = at_random(&[0, 0, 1], &contents(3), 0);
        assert_eq!(missing_side(2, &[0, 0, 1], &sides), Some((1, Split::Train)));
        assert_eq!(missing_side(2, &[0, 0, 1, 1], &at_random(&[0, 0, 1, 1], &contents(4), 0)), None);
    }
}
