//! What goes from one stage to the next.

use crate::consolidation::RegimeMemory;
use crate::driver::Scaling;

use super::Learned;

/// A line of stages, as far as the next one starts from it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Line {
    /// Stages learned.
    pub stages: u32,
    /// The last one's weights; none before the first.
    pub weights: Option<Vec<f32>>,
    /// The first one's; none before it.
    pub scaling: Option<Scaling>,
    /// What is kept of each regime, in the order in which they were first learned.
    pub memory: Vec<RegimeMemory>,
}

impl Line {
    /// One stage more. What is kept of a regime that was learned again takes the place of what was kept of it before.
    pub fn advance(&mut self, learned: &Learned) {
        self.stages += 1;
        self.weights = Some(learned.weights.clone());
        self.scaling = Some(learned.scaling);
        let Some(memory) = learned.memory.clone() else { return };
        match self.memory.iter_mut().find(|kept| kept.regime == memory.regime) {
            Some(kept) => *kept = memory,
            None => self.memory.push(memory),
        }
    }
}
