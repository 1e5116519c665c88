//! The named options of consolidation, and which of them exclude each other.

use serde::{Deserialize, Serialize};

use super::{Kept, Method};

/// How importance is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// Every output's own gradient.
    Exact,
    /// Weighted by the squared residual: EWC's empirical Fisher.
    Empirical,
    /// One backward pass per event and draw, with random seeds: right on average.
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

/// How importance is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImportanceOptions {
    /// Exactly, weighted by residuals, or with random seeds.
    pub estimator: Estimator,
    /// Of the acceleration or of the trajectory.
    pub output: Output,
    /// MAS's gradient.
    pub mas_output: MasOutput,
    /// Backward passes per event of the sampled estimator.
    pub draws: u32,
}

/// Fewest draws from which a mean absolute derivative can be estimated: with two the estimate has no finite variance.
pub const LEAST_SENSITIVITY_DRAWS: u32 = 3;

impl ImportanceOptions {
    /// The option that cannot be had with the others, and why; none when all is well. Without a method, what no method
    /// can have.
    #[must_use]
    pub fn conflict(self, method: Option<Method>) -> Option<(&'static str, String)> {
        let sensitivity = method.and_then(Method::keeps) == Some(Kept::Sensitivity);
        if self.estimator == Estimator::Empirical && self.output == Output::ClosedLoop {
            let why = "empirical weighs by the recorded acceleration, which the closed loop has none of: use it with output open_loop, or take exact or sampled";
            return Some(("estimator", why.to_owned()));
        }
        if self.estimator == Estimator::Empirical && sensitivity {
            let why = "empirical is a Fisher information; MAS's importance looks at no recorded acceleration: take exact or sampled";
            return Some(("estimator", why.to_owned()));
        }
        if self.estimator == Estimator::Sampled && sensitivity && self.draws < LEAST_SENSITIVITY_DRAWS {
            let why = format!("MAS's importance takes at least {LEAST_SENSITIVITY_DRAWS} draws to be sampled");
            return Some(("estimator_draws", why));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_contradicts_itself_is_named() {
        let all = [Estimator::Exact, Estimator::Empirical, Estimator::Sampled];
        let named = |method, output, draws| {
            all.map(|estimator| {
                let options = ImportanceOptions { estimator, output, mas_output: MasOutput::Jacobian, draws };
                options.conflict(method).map(|(name, _)| name)
            })
        };
        assert_eq!(named(None, Output::OpenLoop, 1), [None; 3]);
        assert_eq!(named(Some(Method::Ewc), Output::OpenLoop, 1), [None; 3]);
        assert_eq!(named(Some(Method::Ewc), Output::ClosedLoop, 1), [None, Some("estimator"), None]);
        assert_eq!(named(Some(Method::Mas), Output::OpenLoop, 1), [None, Some("estimator"), Some("estimator_draws")]);
        assert_eq!(named(Some(Method::Mas), Output::ClosedLoop, 3), [None, Some("estimator"), None]);
    }
}
