//! The setting `strength`, where it is not left to the method.

use serde::{Deserialize, Serialize};

/// How strongly a stage consolidates: the wire's `strength`, unless it is null.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a number, \"auto\" or null is needed")]
pub enum Strength {
    /// This strong.
    Fixed(f64),
    /// As strong as a search on validation events finds.
    Searched(Auto),
}

/// The literal `"auto"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Auto {
    /// Every task that consolidates searches its own.
    Auto,
}

impl Strength {
    /// The number; none where it has to be found.
    #[must_use]
    pub fn fixed(self) -> Option<f64> {
        match self {
            Self::Fixed(strength) => Some(strength),
            Self::Searched(Auto::Auto) => None,
        }
    }
}
