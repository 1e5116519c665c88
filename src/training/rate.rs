//! The learning rate along a stage.

use serde::{Deserialize, Serialize};

/// How the learning rate changes over the updates of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RateSchedule {
    /// The same for every update: the paper's.
    Constant,
    /// Up in a straight line over the first tenth of the updates, then down to nothing along half a cosine
    /// (Loshchilov & Hutter 2017, without restarts). The last update moves next to nothing, so a stage does not end in the
    /// middle of a swing.
    Cosine,
}

/// Share of the updates that warm up.
const WARM_UP: f64 = 0.1;

impl RateSchedule {
    /// The factor on the learning rate of update `update` (from 1) of `updates`.
    #[must_use]
    pub fn factor(self, update: u64, updates: u64) -> f64 {
        let done = update as f64 / updates.max(1) as f64;
        match self {
            Self::Constant => 1.0,
            Self::Cosine if done < WARM_UP => done / WARM_UP,
            Self::Cosine => {
                let falling = ((done - WARM_UP) / (1.0 - WARM_UP)).min(1.0);
                0.5 * (1.0 + (std::f64::consts::PI * falling).cos())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cosine_rises_for_a_tenth_and_falls_to_nothing() {
        let factor = |update| RateSchedule::Cosine.factor(update, 100);
        assert!((factor(5) - 0.5).abs() < 1e-12 && (factor(10) - 1.0).abs() < 1e-12);
        assert!((factor(55) - 0.5).abs() < 1e-12 && factor(100) < 1e-12);
        assert!((11..=100).all(|update| factor(update) < factor(update - 1)));
        assert_eq!(RateSchedule::Constant.factor(7, 100), 1.0);
    }
}
