//! Importance from one backward pass per event and draw, right on average.

use super::Kept;
use super::noise::Noise;
use super::seeds::Scalars;
use crate::car_following::Event;
use crate::driver::{Drive, Scaling};
use crate::lstm::{Network, Real};

/// An unbiased estimate of `Σ_n Σ_k (∂y_nk/∂θ)²` or `Σ_n Σ_k |∂y_nk/∂θ|`, one event's gradient at a time.
///
/// Each draw seeds every scalar of the event with a random number `ε_k` and goes back once, which gives `X = Σ_k ε_k g_k`.
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
) -> Vec<f64> {
    let mut sums = vec![0.0; network.weights().len()];
    let mut products = vec![1.0; network.weights().len()];
    let mut gradient = vec![T::zero(); network.weights().len()];
    let share = 1.0 / f64::from(draws);
    for event in events {
        products.fill(1.0);
        for draw in 0..draws {
            let mut noise = Noise::keyed(event, draw);
            let coefficients: Vec<f64> = (0..scalars.count(event))
                .map(|_| match kept {
                    Kept::Fisher => noise.normal(),
                    Kept::Sensitivity => noise.cauchy(),
                })
                .collect();
            scalars.combine(drive, network, scaling, event, &coefficients, &mut gradient);
            for ((sum, product), g) in sums.iter_mut().zip(&mut products).zip(&gradient) {
                match kept {
                    Kept::Fisher => *sum += share * g.wide() * g.wide(),
                    Kept::Sensitivity => *product *= g.wide().abs(),
                }
            }
        }
        if kept == Kept::Sensitivity {
            let scale = (0.5 * std::f64::consts::PI * share).cos().powf(f64::from(draws));
            for (sum, product) in sums.iter_mut().zip(&products) {
                *sum += scale * product.powf(share);
            }
        }
    }
    sums
}
