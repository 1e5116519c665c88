//! Standardisation of the inputs.

use serde::{Deserialize, Serialize};

use super::features::{MAX_INPUTS, Sight};
use super::{DriverShape, Features};
use crate::car_following::Event;
use crate::lstm::{INPUTS, Real};

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
    /// Of the inputs that [`Features::Motion`] adds; none without them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionScaling>,
}

/// Mean and spread of follower acceleration, leader acceleration (m/s²) and inverse time to collision (1/s).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MotionScaling {
    /// Means.
    pub mean: [f32; 3],
    /// Standard deviations, never 0.
    pub spread: [f32; 3],
}

impl Scaling {
    /// Whether it can be a network's of this shape.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check(&self, shape: DriverShape) -> Result<(), String> {
        let motion = self.motion.iter();
        let all = [self.mean, self.spread, self.low, self.high].concat().into_iter();
        let all = all.chain(motion.clone().flat_map(|motion| [motion.mean, motion.spread].concat()));
        let spreads = self.spread.into_iter().chain(motion.flat_map(|motion| motion.spread));
        if !all.into_iter().all(f32::is_finite) {
            return Err("its numbers are to be finite".to_owned());
        }
        if !spreads.into_iter().all(|spread| spread > 0.0) {
            return Err("each spread is to be greater than 0".to_owned());
        }
        match (shape.features, self.motion) {
            (Features::Raw, Some(_)) => Err("motion is for models with features motion; this one has raw".to_owned()),
            (Features::Motion, None) => {
                Err("a model with features motion needs motion: {\"mean\": [3 numbers], \"spread\": [3 numbers]}"
                    .to_owned())
            }
            _ => Ok(()),
        }
    }

    /// Mean and standard deviation over all steps of `events` (in an order of their own, for equal bits).
    #[must_use]
    pub fn estimate(shape: DriverShape, events: &[&Event]) -> Self {
        let mut count = 0.0;
        let (mut sum, mut sum_sq) = ([0.0_f64; MAX_INPUTS], [0.0_f64; MAX_INPUTS]);
        let (mut low, mut high) = ([f32::INFINITY; INPUTS], [f32::NEG_INFINITY; INPUTS]);
        for event in events {
            let (follower, leader) = (event.follower_speed_mps(), event.leader_speed_mps());
            for t in 0..event.steps() {
                let back = t.min(shape.reach());
                let sight = Sight {
                    speed: follower[t],
                    leader: leader[t],
                    spacing: event.spacing_m()[t],
                    earlier: (follower[t - back], leader[t - back]),
                    elapsed_s: back as f32 * shape.dt_s,
                };
                for (k, x) in shape.features.of(&sight).into_iter().enumerate() {
                    sum[k] += f64::from(x);
                    sum_sq[k] += f64::from(x) * f64::from(x);
                    if k < INPUTS {
                        low[k] = low[k].min(x);
                        high[k] = high[k].max(x);
                    }
                }
                count += 1.0;
            }
        }
        let mean = sum.map(|x| x / count);
        let spread: [f32; MAX_INPUTS] = std::array::from_fn(|k| {
            let variance = (sum_sq[k] / count - mean[k] * mean[k]).max(0.0);
            // An input that never changed is left in its own unit.
            if variance > 1e-6 { variance.sqrt() as f32 } else { 1.0 }
        });
        let mean = mean.map(|x| x as f32);
        let motion = (shape.features == Features::Motion)
            .then(|| MotionScaling { mean: [mean[4], mean[5], mean[6]], spread: [spread[4], spread[5], spread[6]] });
        let first = |x: [f32; MAX_INPUTS]| [x[0], x[1], x[2], x[3]];
        Self { mean: first(mean), spread: first(spread), low, high, motion }
    }

    /// Mean and spread of every input.
    pub(super) fn all<T: Real>(&self) -> ([T; MAX_INPUTS], [T; MAX_INPUTS]) {
        let motion = self.motion.unwrap_or(MotionScaling { mean: [0.0; 3], spread: [1.0; 3] });
        let joined = |raw: [f32; 4], added: [f32; 3]| {
            std::array::from_fn(|k| T::of(f64::from(if k < INPUTS { raw[k] } else { added[k - INPUTS] })))
        };
        (joined(self.mean, motion.mean), joined(self.spread, motion.spread))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_inputs_keep_their_unit() {
        let event = Event::new(0.1, vec![20.0, 22.0], vec![8.0; 2], vec![9.0; 2]);
        let scaling = Scaling::estimate(DriverShape::PAPER, &[&event]);
        assert_eq!(scaling.mean, [8.0, 9.0, 1.0, 21.0]);
        assert_eq!(scaling.spread, [1.0, 1.0, 1.0, 1.0]);
        assert_eq!((scaling.low[3], scaling.high[3]), (20.0, 22.0));
        assert_eq!(scaling.motion, None);
    }

    #[test]
    fn motion_is_scaled_too_and_a_scaling_without_it_can_still_be_read() {
        let event = Event::new(0.1, vec![1.0, 3.0], vec![8.0, 8.5], vec![9.0, 9.0]);
        let shape = DriverShape { features: Features::Motion, ..DriverShape::PAPER };
        let motion = Scaling::estimate(shape, &[&event]).motion.unwrap();
        // Accelerations 0 and 5 m/s²; (9 − 8)/(1 + 1) and (9 − 8.5)/(3 + 1) per second.
        assert_eq!(motion.mean, [2.5, 0.0, 0.3125]);
        assert!((motion.spread[0] - 2.5).abs() < 1e-5 && motion.spread[1] == 1.0);
        let old = r#"{"mean":[1,2,3,4],"spread":[1,1,1,1],"low":[0,0,0,0],"high":[1,1,1,1]}"#;
        assert_eq!(serde_json::from_str::<Scaling>(old).unwrap().motion, None);
    }
}
