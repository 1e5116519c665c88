//! Which method learns, and what it does against forgetting.

use serde::{Deserialize, Serialize};

/// How a model learns a new regime. Fixed per model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Train on, with nothing to keep the model from forgetting: the lower bound.
    Naive,
    /// Train afresh on the events of every regime at each stage: the upper bound.
    Joint,
    /// Elastic weight consolidation, Kirkpatrick et al. 2017.
    Ewc,
    /// Memory aware synapses, Aljundi et al. 2018.
    Mas,
}

/// What a consolidating method takes for the importance of a weight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// Mean squared derivative of the outputs: the diagonal Fisher information of a Gaussian head with σ = 1.
    Fisher,
    /// Mean absolute derivative of the outputs.
    Sensitivity,
}

impl Method {
    /// The name on the wire.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Naive => "naive",
            Self::Joint => "joint",
            Self::Ewc => "ewc",
            Self::Mas => "mas",
        }
    }

    /// The importance the method stores with an anchor per regime; none where it stores neither.
    #[must_use]
    pub fn keeps(self) -> Option<Kept> {
        match self {
            Self::Ewc => Some(Kept::Fisher),
            Self::Mas => Some(Kept::Sensitivity),
            Self::Naive | Self::Joint => None,
        }
    }

    /// Whether the method stores importance and an anchor per regime.
    #[must_use]
    pub fn consolidates(self) -> bool {
        self.keeps().is_some()
    }
}
