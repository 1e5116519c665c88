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
    /// Synaptic intelligence, Zenke et al. 2017.
    Si,
    /// Experience replay: some earlier events in every update (Chaudhry et al. 2019, Rolnick et al. 2019).
    Replay,
    /// Replay and EWC together.
    ReplayEwc,
    /// Replay and MAS together.
    ReplayMas,
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
            Self::Si => "si",
            Self::Replay => "replay",
            Self::ReplayEwc => "replay_ewc",
            Self::ReplayMas => "replay_mas",
        }
    }

    /// The importance the method computes from the outputs after a stage; none where it has none or takes another.
    #[must_use]
    pub fn keeps(self) -> Option<Kept> {
        match self {
            Self::Ewc | Self::ReplayEwc => Some(Kept::Fisher),
            Self::Mas | Self::ReplayMas => Some(Kept::Sensitivity),
            Self::Naive | Self::Joint | Self::Replay | Self::Si => None,
        }
    }

    /// Whether importance is gathered along the way of a stage: see [`PathIntegral`](super::PathIntegral).
    #[must_use]
    pub fn follows_path(self) -> bool {
        self == Self::Si
    }

    /// Whether the method stores importance and an anchor per regime.
    #[must_use]
    pub fn consolidates(self) -> bool {
        self.keeps().is_some() || self.follows_path()
    }

    /// What importance is multiplied with in `½ Σ A (θ − θ*)²`: EWC's penalty has the ½, MAS's and SI's have not.
    pub(super) fn penalty_factor(self) -> f64 {
        if self.keeps() == Some(Kept::Fisher) { 1.0 } else { 2.0 }
    }

    /// Whether earlier events of the line take part in every update.
    #[must_use]
    pub fn replays(self) -> bool {
        matches!(self, Self::Replay | Self::ReplayEwc | Self::ReplayMas)
    }
}
