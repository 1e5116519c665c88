//! What decides how a driver computes, besides its weights.

use serde::{Deserialize, Serialize};

use super::Features;
use crate::lstm::Layout;

/// Whether the network encodes each window afresh or carries one state along the event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Memory {
    /// The last `horizon` steps from a zero state at every step: the paper's.
    Window,
    /// One state from the first step of the event on, warmed on the window when predicting.
    Carried,
}

/// What decides how a driver computes, besides its weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriverShape {
    /// Hidden units.
    pub hidden: usize,
    /// Steps in a window.
    pub horizon: usize,
    /// Step, s.
    pub dt_s: f32,
    /// The acceleration lies within ± this, m/s².
    pub accel_limit_mps2: f32,
    /// How the network remembers.
    pub memory: Memory,
    /// What it reads of a step.
    pub features: Features,
}

impl DriverShape {
    /// The paper's, with `FollowNet`'s number of hidden units and the limit of this project.
    pub const PAPER: Self = Self {
        hidden: 128,
        horizon: 10,
        dt_s: 0.1,
        accel_limit_mps2: 4.0,
        memory: Memory::Window,
        features: Features::Raw,
    };

    /// The layout of its weights.
    #[must_use]
    pub fn layout(self) -> Layout {
        Layout { hidden: self.hidden, inputs: self.features.inputs() }
    }

    /// Steps that the accelerations among the features look back from the newest of a window.
    #[must_use]
    pub fn reach(self) -> usize {
        self.horizon - 1
    }
}
