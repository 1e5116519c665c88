//! How what is kept of several regimes adds up.

use super::{Accumulation, RegimeMemory};

/// A rule of accumulation with its decay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accumulate {
    /// The rule.
    pub rule: Accumulation,
    /// γ of `online`, within 0 to 1.
    pub decay: f64,
}

impl Accumulate {
    /// Whether each regime pulls towards its own anchor; else all pull towards the latest weights.
    pub(super) fn keeps_anchors(self) -> bool {
        self.rule == Accumulation::Separate
    }

    /// What each regime's importance is multiplied with, in the order of `memory`.
    ///
    /// Online (Schwarz et al. 2018): `F̃ ← γ F̃ + F` after each regime, and γ F̃ in the loss, so a regime counts γᵃ, with age
    /// a = 1 for the one learned last, 2 for the one before it. A regime that comes again becomes the latest and counts once:
    /// it neither stiffens the model nor lets the others age more than once.
    pub(super) fn shares(self, memory: &[RegimeMemory]) -> Vec<f64> {
        let age = |kept: &RegimeMemory| 1 + memory.iter().filter(|other| other.stage > kept.stage).count();
        match self.rule {
            Accumulation::Separate | Accumulation::SumLatest => vec![1.0; memory.len()],
            Accumulation::Online => memory.iter().map(|kept| self.decay.powf(age(kept) as f64)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn online_counts_regimes_by_when_they_were_last_learned() {
        let learned_at = |stages: &[u32]| {
            let kept =
                |&stage| RegimeMemory { regime: String::new(), importance: vec![], anchor: vec![], samples: 1, stage };
            let memory: Vec<_> = stages.iter().map(kept).collect();
            Accumulate { rule: Accumulation::Online, decay: 0.5 }.shares(&memory)
        };
        assert_eq!(learned_at(&[1, 2, 3]), [0.125, 0.25, 0.5]);
        assert_eq!(learned_at(&[4, 2, 3]), [0.5, 0.125, 0.25]);
        assert_eq!(learned_at(&[104, 2, 3]), [0.5, 0.125, 0.25], "a hundred times is as once");
    }
}
