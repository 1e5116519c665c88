//! Standardisation of the inputs.

use serde::{Deserialize, Serialize};

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
