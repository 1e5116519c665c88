//! Reading a safetensors file as a version: one of ours, or a network that was trained elsewhere.

mod defect;
mod file;
mod keys;
mod ours;
mod theirs;

#[cfg(test)]
mod tests;

use crate::consolidation::{Method, RegimeMemory};
use crate::driver::Scaling;
use crate::lineage::{ModelName, ModelSettings, RegimeName};
pub use defect::{ArtifactError, Defect};
use file::File;
use keys::Keys;

/// A version that a file brings.
#[derive(Debug, Clone, PartialEq)]
pub struct Brought {
    /// The version it was elsewhere; none for a network that was trained elsewhere.
    pub origin: Option<Origin>,
    /// Position on its line of parents, from 1.
    pub stage: u32,
    /// The regime that its stage learned.
    pub regime: RegimeName,
    /// Every regime its line has learned, in the order first learned; the one above among them.
    pub regimes: Vec<BroughtRegime>,
    /// Of the version; of the model it is brought to where the file says nothing of them.
    pub settings: ModelSettings,
    /// Null where unused.
    pub strength: Option<f64>,
    /// Null where unused.
    pub lambda: Option<f64>,
    /// Name of the arithmetic that made it.
    pub kernel: String,
    /// Training events of its stage; 0 where that is not known.
    pub train_events: u64,
    /// Over the sorted digests of these.
    pub events_sha256: [u8; 32],
    /// Standardisation.
    pub scaling: Scaling,
    /// One flat vector.
    pub weights: Vec<f32>,
}

/// Where a version is from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// The model there.
    pub model: ModelName,
    /// Its number there.
    pub version: i64,
    /// Whether it, or one it continues, learned what was retracted later.
    pub tainted: bool,
}

/// A regime of the line.
#[derive(Debug, Clone, PartialEq)]
pub struct BroughtRegime {
    /// Its name.
    pub regime: RegimeName,
    /// The last stage that learned it.
    pub stage: u32,
    /// What is kept of it; none where nothing is.
    pub memory: Option<RegimeMemory>,
}

/// Reads a file for a model of this method with these settings. What it takes in memory is bounded by the length of the file.
///
/// # Errors
/// When it is no safetensors file, or none that can be a version of this model: everything that is found wrong at the same
/// step is told.
pub fn read(bytes: &[u8], method: Method, settings: &ModelSettings) -> Result<Brought, ArtifactError> {
    let file = File::parse(bytes)?;
    let keys = Keys::of(&file);
    if keys.has("headway_format") {
        ours::read(&file, &keys, method, settings)
    } else {
        theirs::read(&file, &keys, settings)
    }
}
