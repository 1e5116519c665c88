//! From the strength a user turns to the λ of the formula.

use super::{Accumulation, Method, Penalty};

/// Strength where none is set; the same for generated and recorded data.
#[must_use]
pub fn default_strength(method: Method) -> f64 {
    match method {
        Method::Ewc | Method::Mas => 1.0,
        Method::Naive | Method::Joint => 0.0,
    }
}

/// Accumulation where none is set.
#[must_use]
pub fn default_accumulation(_method: Method) -> Accumulation {
    Accumulation::Separate
}

/// λ for a strength.
#[must_use]
pub fn lambda(strength: f64, penalty: &Penalty, regimes: usize) -> f64 {
    let scale = penalty.mean_stiffness(regimes);
    if scale > 0.0 { strength / scale } else { 0.0 }
}
