//! Loss and gradient of one minibatch.

use super::loss::{Penalties, loss};
use crate::car_following::Event;
use crate::driver::{By, Crew, Drive, Loop, Scaling, TrajectoryGradient};
use crate::lstm::{Network, Real};

/// The loss of `events` driven closed loop, and its exact derivative by every weight in `gradient`, which is overwritten.
pub fn minibatch_gradient<T: Real>(
    crew: &Crew<'_, T>,
    horizon: usize,
    scaling: &Scaling,
    network: &Network<T>,
    events: &[&Event],
    penalties: Penalties,
    gradient: &mut [T],
) -> f64 {
    let steps: usize = events.iter().map(|event| event.steps() - horizon).sum();
    let part = |drive: &mut Drive<T>, piece: &[&Event]| {
        let mut by = TrajectoryGradient { spacing: Vec::new(), speed: Vec::new() };
        let mut gradient = vec![T::zero(); network.weights().len()];
        drive.forward(network, scaling, piece, Loop::Closed);
        let loss = loss(drive, horizon, piece, penalties, steps, &mut by);
        drive.backward(network, scaling, By::Trajectory(&by), &mut gradient);
        (loss, gradient)
    };
    gradient.fill(T::zero());
    let mut total = 0.0;
    crew.each(events, part, |(loss, part)| {
        total += loss;
        for (g, p) in gradient.iter_mut().zip(part) {
            *g += p;
        }
    });
    total
}
