//! What a prediction and a simulation answer.

use serde::Serialize;

/// What a client should know about an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Flag {
    /// An input lies outside what training saw: the network extrapolates.
    OutOfRange,
    /// The served value is not the network's.
    Envelope,
    /// The window is not full yet; its first step stands for the missing ones.
    WarmingUp,
}

impl Flag {
    /// Every flag, in order.
    pub const ALL: [Self; 3] = [Self::OutOfRange, Self::Envelope, Self::WarmingUp];

    /// Its name on the wire.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::OutOfRange => "out_of_range",
            Self::Envelope => "envelope",
            Self::WarmingUp => "warming_up",
        }
    }
}

/// The answer to one window.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prediction {
    /// What is served, m/s².
    pub accel_mps2: f32,
    /// The network's, m/s².
    pub raw_accel_mps2: f32,
    /// In order of their names above; none twice.
    pub flags: Vec<Flag>,
}

/// A follower driven behind a given leader: one value per leader step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Simulated {
    /// m.
    pub spacing_m: Vec<f32>,
    /// m/s.
    pub follower_speed_mps: Vec<f32>,
    /// As served, m/s².
    pub accel_mps2: Vec<f32>,
    /// Whether some spacing is ≤ 0.
    pub collided: bool,
    /// Over the whole drive.
    pub flags: Vec<Flag>,
}
