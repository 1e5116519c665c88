//! What a search for a strength saw, as it is kept with the version.

use serde::{Deserialize, Serialize};

use super::RegimeName;

/// A search for the strength of one stage, on validation events alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StrengthSearch {
    /// Which events were driven, in words.
    pub events: String,
    /// The regimes they are of: those learned earlier in the order first learned, then the one the stage learns.
    pub regimes: Vec<SearchedRegime>,
    /// Of every random choice.
    pub seed: u64,
    /// The strength the stage was learned with.
    pub chosen: f64,
    /// How it was chosen from the candidates, in words.
    pub rule: String,
    /// What kept the search from being what it should be; null where nothing did.
    pub note: Option<String>,
    /// What the errors are measured against, m², one a regime: the parent's on those learned earlier, on the new one that of
    /// the stage learned without a penalty. Null without validation events.
    pub naive_diagonal: Vec<Option<f64>>,
    /// Every strength tried, ascending; none where nothing could be searched.
    pub candidates: Vec<SearchedStrength>,
}

/// Validation events of one regime.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SearchedRegime {
    /// The regime.
    pub regime: RegimeName,
    /// Events driven.
    pub events: u32,
    /// Whether they come from earlier tasks of the line.
    pub earlier: bool,
}

/// What one strength came to. All but `strength` and `diverged` are null where training diverged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SearchedStrength {
    /// The strength.
    pub strength: f64,
    /// Mean over the regimes of the error over `naive_diagonal`.
    pub cost: Option<f64>,
    /// Its mean over the regimes learned earlier; 1 where there are none.
    pub forgetting_ratio: Option<f64>,
    /// The error over `naive_diagonal` on the regime that was learned.
    pub plasticity_loss: Option<f64>,
    /// Events with some simulated spacing ≤ 0, in all regimes.
    pub collisions: Option<u32>,
    /// m², one a regime; null without validation events.
    pub spacing_mse: Option<Vec<Option<f64>>>,
    /// Why training gave nothing; null where it did.
    pub diverged: Option<String>,
}
