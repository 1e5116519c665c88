//! What a safetensors file says of its version beside the tensors.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::consolidation::Method;
use crate::lineage::{ModelName, ModelSettings, RegimeName};

/// The number of this format; a file with another is not read.
pub const FORMAT: &str = "1";

/// Everything about a version that is not an array.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Where it is from.
    pub model: ModelName,
    /// Its number there.
    pub version: i64,
    /// The model's method.
    pub method: Method,
    /// Position on its line of parents, from 1.
    pub stage: u32,
    /// The regime that its stage learned.
    pub regime: RegimeName,
    /// Every regime its line has learned, in the order first learned.
    pub regimes: Vec<RememberedRegime>,
    /// Resolved.
    pub settings: ModelSettings,
    /// Null where unused.
    pub strength: Option<f64>,
    /// Null where unused.
    pub lambda: Option<f64>,
    /// Name of the arithmetic that made it.
    pub kernel: String,
    /// Training events of its stage.
    pub train_events: u64,
    /// SHA-256 over the sorted digests of the training events, hex.
    pub events_sha256: String,
    /// Standardisation, JSON of a [`Scaling`](crate::driver::Scaling).
    pub scaling: Value,
    /// SHA-256 over the little-endian flat weights, hex.
    pub weights_sha256: String,
    /// Whether it, or one it continues, learned what was retracted later.
    pub tainted: bool,
}

/// A regime of the line, without what consolidation keeps of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RememberedRegime {
    /// Its name.
    pub regime: RegimeName,
    /// The last stage that learned it.
    pub stage: u32,
    /// Supervised steps behind its importance; null where nothing is kept of it.
    pub samples: Option<u64>,
    /// SHA-256 over the little-endian importance, then the anchor, hex; null likewise.
    pub anchor_sha256: Option<String>,
}

impl Record {
    /// The keys of `__metadata__`, whose values are text in this format.
    #[must_use]
    pub fn metadata(&self) -> BTreeMap<&'static str, String> {
        let mut keys = BTreeMap::from([
            // What loaders for torch look at.
            ("format", "pt".to_owned()),
            ("headway_format", FORMAT.to_owned()),
            ("model", self.model.to_string()),
            ("version", self.version.to_string()),
            ("method", self.method.as_str().to_owned()),
            ("stage", self.stage.to_string()),
            ("regime", self.regime.to_string()),
            ("regimes", json!(self.regimes).to_string()),
            ("settings", json!(self.settings).to_string()),
            ("kernel", self.kernel.clone()),
            ("train_events", self.train_events.to_string()),
            ("events_sha256", self.events_sha256.clone()),
            ("scaling", self.scaling.to_string()),
            ("accel_limit_mps2", self.settings.accel_limit_mps2.to_string()),
            ("horizon", self.settings.horizon.to_string()),
            ("dt_s", self.settings.dt_s.to_string()),
            ("seed", self.settings.seed.to_string()),
            ("weights_sha256", self.weights_sha256.clone()),
            ("tainted", self.tainted.to_string()),
        ]);
        keys.extend(self.strength.map(|strength| ("strength", json!(strength).to_string())));
        keys.extend(self.lambda.map(|lambda| ("lambda", json!(lambda).to_string())));
        keys
    }
}
