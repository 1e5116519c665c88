//! From the strength a user turns to the λ of the formula.

use super::{Accumulation, Method, Penalty, PenaltyStep};

/// Strength where none is set: what kept old traffic and learned new on generated and on recorded data alike. Beside replay
/// a third of it does.
#[must_use]
pub fn default_strength(method: Method) -> f64 {
    match (method.consolidates(), method.replays()) {
        (false, _) => 0.0,
        (true, false) => 1.0,
        (true, true) => 0.3,
    }
}

/// Times the default strength: what a search tries.
const SEARCHED: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];

/// The strengths that a search tries for this method, ascending.
#[must_use]
pub fn searched_strengths(method: Method) -> [f64; 5] {
    SEARCHED.map(|factor| factor * default_strength(method))
}

/// Accumulation where none is set.
#[must_use]
pub fn default_accumulation(_method: Method) -> Accumulation {
    Accumulation::Separate
}

/// `λ A` of a weight of typical importance at strength 1.
///
/// The proximal step competes with an optimiser whose steps are about as long as the learning rate whatever the loss, so λA
/// has the unit of 1/weight there: with 15 a typical weight goes no further than about 1/15 from its anchor. The modulated step
/// only slows: a stage of 400 updates at a rate of 0.001 takes a weight 0.4 far at most, and 5,000 leaves a sixth of that,
/// as far as the proximal step lets it go. The coupled step competes with the gradient of the loss, and needs less.
fn typical_pull(step: PenaltyStep) -> f64 {
    match step {
        PenaltyStep::Proximal => 15.0,
        PenaltyStep::Modulated => 5000.0,
        PenaltyStep::Coupled => 0.4,
    }
}

/// λ for a strength: `strength · typical_pull / (typical A of a regime)`.
///
/// Importance has a scale of its own: it falls with the number of weights, grows with the acceleration limit squared, and
/// MAS's is about the root of EWC's. Its median over the weights carries that scale; its mean does not, since half of it
/// can sit in the head's bias alone. Dividing by it makes one strength serve both methods and networks of any size.
#[must_use]
pub fn lambda(strength: f64, step: PenaltyStep, penalty: &Penalty) -> f64 {
    let typical = penalty.typical_stiffness();
    if typical > 0.0 { strength * typical_pull(step) / typical } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consolidation::{Accumulate, RegimeMemory};

    fn penalty(scale: f32) -> Penalty {
        let importance = [0.0, 1.0, 2.0, 3.0, 1000.0].map(|x| x * scale).to_vec();
        let memory = RegimeMemory { regime: String::new(), importance, anchor: vec![0.0; 5], samples: 1, stage: 1 };
        let separate = Accumulate { rule: Accumulation::Separate, decay: 1.0 };
        Penalty::collapse(Method::Ewc, separate, &[memory.clone(), memory], &[0.0; 5]).unwrap()
    }

    #[test]
    fn the_pull_on_a_typical_weight_does_not_depend_on_the_scale_of_importance() {
        for scale in [1e-9, 1.0, 1e6] {
            let penalty = penalty(scale);
            let pull = lambda(2.0, PenaltyStep::Proximal, &penalty) * penalty.typical_stiffness();
            assert!((pull - 30.0).abs() < 1e-9, "{pull}");
        }
    }

    #[test]
    fn without_importance_nothing_pulls() {
        assert_eq!(lambda(1.0, PenaltyStep::Proximal, &penalty(0.0)), 0.0);
    }
}
