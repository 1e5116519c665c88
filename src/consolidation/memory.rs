//! What is kept of each regime, and how a regime that comes again is merged.

use serde::{Deserialize, Serialize};

/// What is kept of one regime: its diagonal importance and the weights it is anchored at, one value per weight each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RegimeMemory {
    /// The regime's name.
    pub regime: String,
    /// Diagonal importance, mean per supervised step.
    pub importance: Vec<f32>,
    /// The weights at the end of the last stage that learned the regime.
    pub anchor: Vec<f32>,
    /// Supervised steps behind the importance.
    pub samples: u64,
    /// The last stage that learned it.
    pub stage: u32,
}

impl RegimeMemory {
    /// What is kept after a stage learned `regime`: new importance alone, or averaged by sample count with what was kept of
    /// the same regime before, so that the hundredth time is no stiffer than the first. The anchor moves to the new weights.
    #[must_use]
    pub fn after(regime: &str, stage: u32, earlier: Option<&Self>, new: (&[f64], u64), weights: &[f32]) -> Self {
        let (importance, samples) = new;
        let kept = earlier.map_or(0, |earlier| earlier.samples);
        let all = (kept + samples).max(1) as f64;
        let (old_share, new_share) = (kept as f64 / all, samples as f64 / all);
        let importance = importance
            .iter()
            .enumerate()
            .map(|(i, new)| {
                let old = earlier.map_or(0.0, |earlier| f64::from(earlier.importance[i]));
                (old_share * old + new_share * new) as f32
            })
            .collect();
        Self { regime: regime.to_owned(), importance, anchor: weights.to_vec(), samples: kept + samples, stage }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_regime_that_repeats_is_averaged_by_sample_count() {
        let first = RegimeMemory::after("fast", 1, None, (&[1.0, 4.0], 300), &[0.5, 0.5]);
        assert_eq!(first.importance, [1.0, 4.0]);
        let second = RegimeMemory::after("fast", 3, Some(&first), (&[5.0, 0.0], 100), &[0.6, 0.7]);
        assert_eq!(second.importance, [2.0, 3.0]);
        assert_eq!((second.anchor.as_slice(), second.samples, second.stage), ([0.6, 0.7].as_slice(), 400, 3));
    }

    #[test]
    fn a_hundred_repeats_are_no_stiffer_than_one() {
        let once = RegimeMemory::after("fast", 1, None, (&[1.0, 4.0], 300), &[0.5, 0.5]);
        let often = (0..99)
            .fold(once.clone(), |m, _| RegimeMemory::after("fast", 2, Some(&m), (&[1.0, 4.0], 300), &[0.5, 0.5]));
        for (often, once) in often.importance.iter().zip(&once.importance) {
            assert!((often / once - 1.0).abs() < 1e-4);
        }
    }
}
