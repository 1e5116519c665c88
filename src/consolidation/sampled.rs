//! Importance from one backward pass per event and draw, right on average.

use super::Kept;
use super::geometric::GeometricMean;
use super::noise::Noise;
use super::seeds::Scalars;
use crate::car_following::Event;
use crate::driver::{Drive, Scaling};
use crate::lstm::{Network, Real, vectorised};

/// An unbiased estimate of `Σ_n Σ_k (∂y_nk/∂θ)²` or `Σ_n Σ_k |∂y_nk/∂θ|` for events that are sorted longest first.
///
/// Events are driven together, once; each draw seeds every scalar with a random number `ε_k` and goes back once through all of
/// them, which gives `X = Σ_k ε_k g_k` of every event on its own.
///
/// - Squares: with normal ε, `E X² = Σ g_k²`; the mean over D draws has the relative variance 2/D, for one event.
/// - Absolute values: with Cauchy ε, X is Cauchy with scale `Σ |g_k|` (the law is 1-stable). Its mean does not exist, but
///   `cosᴰ(π/2D) · Π_d |X_d|^(1/D)` is unbiased for the scale, with the relative variance `cos²ᴰ(π/2D) / cosᴰ(π/D) − 1`:
///   2.4, 1.1 and 0.4 for D = 3, 4 and 8, none for fewer than 3 (Li, Hastie & Church 2007, their geometric-mean estimator).
///
/// Both fall with the number of events as that of any mean. Noise is keyed by event and draw.
pub(super) fn sampled<T: Real>(
    drive: &mut Drive<T>,
    scalars: Scalars,
    kept: Kept,
    draws: u32,
    network: &Network<T>,
    scaling: &Scaling,
    events: &[&Event],
) -> Vec<T> {
    let parameters = network.weights().len();
    let mut sums = vec![T::zero(); parameters];
    let share = 1.0 / f64::from(draws);
    let mut means: Vec<_> = match kept {
        Kept::Fisher => Vec::new(),
        Kept::Sensitivity => events.iter().map(|_| GeometricMean::new(parameters)).collect(),
    };
    scalars.drive(drive, network, scaling, events);
    for draw in 0..draws {
        let coefficients: Vec<_> = events.iter().map(|event| noise(kept, event, draw, scalars.count(event))).collect();
        scalars.combine(drive, network, scaling, events, &coefficients, |n, gradient| match kept {
            Kept::Fisher => add_squares(gradient, share, &mut sums),
            Kept::Sensitivity => means[n].add(gradient),
        });
    }
    let unbiased = (0.5 * std::f64::consts::PI * share).cos().powf(f64::from(draws));
    for mean in &mut means {
        mean.add_to(unbiased, &mut sums);
    }
    sums
}

/// What an event's scalars are seeded with.
fn noise(kept: Kept, event: &Event, draw: u32, count: usize) -> Vec<f64> {
    let mut noise = Noise::keyed(event, draw);
    let each = |_| match kept {
        Kept::Fisher => noise.normal(),
        Kept::Sensitivity => noise.cauchy(),
    };
    (0..count).map(each).collect()
}

fn add_squares<T: Real>(gradient: &[T], share: f64, sums: &mut [T]) {
    let share = T::of(share);
    vectorised(
        #[inline(always)]
        || {
            for (sum, g) in sums.iter_mut().zip(gradient) {
                *sum += share * *g * *g;
            }
        },
    );
}
