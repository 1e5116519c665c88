//! Which method learns, and the named options of consolidation.

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

    /// Whether the method stores importance and an anchor per regime.
    #[must_use]
    pub fn consolidates(self) -> bool {
        matches!(self, Self::Ewc | Self::Mas)
    }
}

/// How importance is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// Every step's own gradient.
    Exact,
    /// Weighted by the squared residual: EWC's empirical Fisher.
    Empirical,
    /// One backward pass per event with random signs.
    Sampled,
}

/// Over which output importance is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Output {
    /// The acceleration on recorded windows.
    OpenLoop,
    /// The simulated trajectory.
    ClosedLoop,
}

/// Which gradient MAS takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MasOutput {
    /// mean |∂ŷ/∂θ|, the paper's formula.
    Jacobian,
    /// mean |∂ŷ²/∂θ|, Aljundi's.
    SquaredNorm,
}

/// How the importance of several regimes adds up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Accumulation {
    /// Each regime keeps its own anchor (Kirkpatrick).
    Separate,
    /// A decaying sum and the latest anchor (Schwarz et al. 2018).
    Online,
    /// A sum and the latest anchor (MAS as published).
    SumLatest,
}

/// How the penalty is applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PenaltyStep {
    /// A loss term, through the optimiser.
    Coupled,
    /// A closed-form pull after the optimiser's step.
    Proximal,
    /// A factor on each weight's increment.
    Modulated,
}
