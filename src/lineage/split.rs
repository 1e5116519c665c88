//! Which side of training an event is on.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Training, validation or test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Learned from.
    Train,
    /// Driven after every epoch, to see how far learning is, and to find a strength.
    Validation,
    /// Kept for evaluation.
    Test,
}

impl Split {
    /// The name on the wire and in the database.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }

    /// The split of this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        [Self::Train, Self::Validation, Self::Test].into_iter().find(|split| split.as_str() == name)
    }

    /// The split of an event that does not name one itself: 70 % training, 15 % validation, 15 % test.
    ///
    /// A hash of (`split_seed`, source, run), so that a recording stays on one side; of `split_seed` and the content's
    /// digest when the event names no run. The first eight bytes of a SHA-256, as a share of 2⁶⁴, choose the side.
    #[must_use]
    pub fn assign(split_seed: u64, source: Option<&str>, run: Option<&str>, content_sha256: &[u8; 32]) -> Self {
        let mut hasher = Sha256::new();
        hasher.update(split_seed.to_le_bytes());
        if let Some(run) = run {
            let source = source.unwrap_or_default();
            // The length keeps ("ab", "c") and ("a", "bc") apart; the tag keeps runs and contents apart.
            hasher.update(b"run");
            hasher.update((source.len() as u64).to_le_bytes());
            hasher.update(source);
            hasher.update(run);
        } else {
            hasher.update(b"content");
            hasher.update(content_sha256);
        }
        let digest: [u8; 32] = hasher.finalize().into();
        let draw = u64::from_le_bytes(digest[..8].try_into().expect("eight bytes"));
        match (u128::from(draw) * 100) >> 64 {
            0..70 => Self::Train,
            70..85 => Self::Validation,
            _ => Self::Test,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splits_are_seventy_fifteen_fifteen() {
        let mut counts = std::collections::BTreeMap::new();
        for i in 0..20_000 {
            let split = Split::assign(0, Some("site"), Some(&format!("run-{i}")), &[0; 32]);
            *counts.entry(split.as_str()).or_insert(0) += 1;
        }
        assert!((13_700..14_300).contains(&counts["train"]), "{counts:?}");
        assert!((2_800..3_200).contains(&counts["validation"]), "{counts:?}");
        assert!((2_800..3_200).contains(&counts["test"]), "{counts:?}");
    }

    #[test]
    fn a_run_stays_on_one_side_whatever_the_content() {
        for run in ["a", "b", "c"] {
            let sides: Vec<_> = (0..50).map(|i| Split::assign(7, Some("s"), Some(run), &[i; 32])).collect();
            assert!(sides.iter().all(|&side| side == sides[0]));
        }
    }

    #[test]
    fn without_a_run_content_and_seed_decide() {
        let sides = |seed| (0..64).map(|i| Split::assign(seed, Some("s"), None, &[i; 32])).collect::<Vec<_>>();
        assert_eq!(sides(1), sides(1));
        assert_ne!(sides(1), sides(2));
        assert!(sides(1).iter().any(|&side| side != Split::Train));
    }

    #[test]
    fn source_and_run_are_told_apart() {
        let differ = (0..64).any(|i| {
            Split::assign(i, Some("ab"), Some("c"), &[0; 32]) != Split::assign(i, Some("a"), Some("bc"), &[0; 32])
        });
        assert!(differ);
    }
}
