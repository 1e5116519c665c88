//! Importance from every output's own gradient.

use super::Kept;
use super::seeds::Scalars;
use crate::car_following::Event;
use crate::driver::{Drive, OwnGradients, Scaling};
use crate::lstm::{Magnitude, Network, Real};

/// What is added up of each gradient.
pub(super) fn magnitude(kept: Kept) -> Magnitude {
    match kept {
        Kept::Fisher => Magnitude::Square,
        Kept::Sensitivity => Magnitude::Absolute,
    }
}

/// `Σ_n Σ_t |∂y_nt/∂θ|` or its squares over the open loop, window by window, since none reads what another one answered.
pub(super) fn open_loop<T: Real>(
    own: &mut OwnGradients<T>,
    scalars: Scalars,
    kept: Kept,
    network: &Network<T>,
    scaling: &Scaling,
    events: &[&Event],
) -> Vec<T> {
    let mut sums = vec![T::zero(); network.weights().len()];
    for event in events {
        own.add(network, scaling, event, magnitude(kept), |t, a| scalars.by_accel(event, t, a));
    }
    own.finish(&mut sums);
    sums
}

/// The same over any scalars, one backward pass for each: what the quicker ways are checked against, and the only exact one
/// for the closed loop and for a carried state, where every step is an outcome of all before it.
pub(super) fn one_by_one<T: Real>(
    drive: &mut Drive<T>,
    scalars: Scalars,
    kept: Kept,
    network: &Network<T>,
    scaling: &Scaling,
    events: &[&Event],
) -> Vec<T> {
    let mut sums = vec![T::zero(); network.weights().len()];
    scalars.drive(drive, network, scaling, events);
    // Shorter events have fewer scalars, and go on without any.
    let mut coefficients: Vec<_> = events.iter().map(|event| vec![0.0; scalars.count(event)]).collect();
    for k in 0..scalars.count(events[0]) {
        set(&mut coefficients, k, 1.0);
        scalars.combine(drive, network, scaling, events, &coefficients, |_, gradient| {
            for (sum, g) in sums.iter_mut().zip(gradient) {
                *sum += match kept {
                    Kept::Fisher => *g * *g,
                    Kept::Sensitivity => g.abs(),
                };
            }
        });
        set(&mut coefficients, k, 0.0);
    }
    sums
}

/// Coefficient `k` of every event that has so many.
fn set(coefficients: &mut [Vec<f64>], k: usize, value: f64) {
    coefficients.iter_mut().filter_map(|of_event| of_event.get_mut(k)).for_each(|of_k| *of_k = value);
}
