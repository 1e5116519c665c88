//! Standardisation of the inputs.

use serde::{Deserialize, Serialize};

use crate::car_following::Event;
use crate::lstm::INPUTS;

/// Mean and spread of the four inputs, in the order follower speed, leader speed, relative speed (m/s), spacing (m).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scaling {
    /// Means.
    pub mean: [f32; 4],
    /// Standard deviations, never 0.
    pub spread: [f32; 4],
    /// Least values seen in training, for the `out_of_range` flag.
    pub low: [f32; 4],
    /// Greatest values seen in training.
    pub high: [f32; 4],
}

impl Scaling {
    /// Mean and standard deviation over all steps of `events` (in an order of their own, for equal bits).
    #[must_use]
    pub fn estimate(events: &[&Event]) -> Self {
        let mut count = 0.0;
        let (mut sum, mut sum_sq) = ([0.0_f64; INPUTS], [0.0_f64; INPUTS]);
        let (mut low, mut high) = ([f32::INFINITY; INPUTS], [f32::NEG_INFINITY; INPUTS]);
        for event in events {
            for t in 0..event.steps() {
                let (v, l) = (event.follower_speed_mps()[t], event.leader_speed_mps()[t]);
                for (k, x) in [v, l, l - v, event.spacing_m()[t]].into_iter().enumerate() {
                    sum[k] += f64::from(x);
                    sum_sq[k] += f64::from(x) * f64::from(x);
                    low[k] = low[k].min(x);
                    high[k] = high[k].max(x);
                }
                count += 1.0;
            }
        }
        let mean = sum.map(|x| x / count);
        let spread = std::array::from_fn(|k| {
            let variance = (sum_sq[k] / count - mean[k] * mean[k]).max(0.0);
            // An input that never changed is left in its own unit.
            if variance > 1e-6 { variance.sqrt() as f32 } else { 1.0 }
        });
        Self { mean: mean.map(|x| x as f32), spread, low, high }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_inputs_keep_their_unit() {
        let event = Event::new(0.1, vec![20.0, 22.0], vec![8.0; 2], vec![9.0; 2]);
        let scaling = Scaling::estimate(&[&event]);
        assert_eq!(scaling.mean, [8.0, 9.0, 1.0, 21.0]);
        assert_eq!(scaling.spread, [1.0, 1.0, 1.0, 1.0]);
        assert_eq!((scaling.low[3], scaling.high[3]), (20.0, 22.0));
    }
}
