//! A version learned again from its ledger, to see whether the same comes out.

use serde::Serialize;

use super::error::JobError;
use super::stage::Stage;
use crate::lineage::Strength;
use crate::lstm::kernel_name;
use crate::store::version::weights_sha256;
use crate::store::{Store, StoreError};
use crate::training::{Observer, Progress, learn_stage};

/// What came of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Retrained {
    /// The version.
    pub version: i64,
    /// Name of the arithmetic that made it.
    pub kernel: String,
    /// Name of this machine's, with which it was learned again.
    pub this_kernel: &'static str,
    /// Digest of its weights.
    pub weights_sha256: String,
    /// Digest of the weights that came out.
    pub again_sha256: String,
    /// Whether the events that were learned are those the version says.
    pub same_events: bool,
}

impl Retrained {
    /// Whether the same came out of the same.
    #[must_use]
    pub fn is_same(&self) -> bool {
        self.same_events && self.weights_sha256 == self.again_sha256
    }
}

/// Why a version cannot be learned again.
#[derive(Debug, thiserror::Error)]
pub enum RetrainError {
    /// The model has no such version.
    #[error("the model has no version {0}")]
    Unknown(i64),
    /// No task made it.
    #[error("no task made version {0}")]
    NotLearned(i64),
    /// The store failed, or what it holds is corrupt.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// It cannot be learned from what is there.
    #[error("{0}")]
    Failed(String),
}

/// Learns a version again in memory, with the settings and the strength it has: what a search for that strength measured is
/// not measured anew. `progress` is told the share done.
///
/// # Errors
/// When there is no such version, what it was learned from is gone or corrupt, or learning fails.
pub async fn retrain(
    store: &Store,
    model_id: i64,
    version: i64,
    threads: usize,
    progress: &mut dyn FnMut(f64),
) -> Result<Retrained, RetrainError> {
    let known = store.version(model_id, version).await?.ok_or(RetrainError::Unknown(version))?;
    let task = match known.task_id {
        Some(task_id) => store.task(model_id, task_id).await?,
        None => None,
    };
    let task = task.ok_or(RetrainError::NotLearned(version))?;
    let mut settings = known.settings.clone();
    if known.strength_search.is_some() {
        settings.strength = known.strength.map(Strength::Fixed);
    }
    let model = store.intact_model(model_id).await?;
    let stage = Stage::load_with(store, task, model, settings).await.map_err(|error| match error {
        JobError::Store(error) => RetrainError::Store(error),
        error => RetrainError::Failed(error.to_string()),
    })?;
    let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let workers = workers.map_err(|error| RetrainError::Failed(error.to_string()))?;
    let learned = learn_stage(&stage.input(), None, &workers, &mut Told(progress));
    let learned = learned.map_err(|error| RetrainError::Failed(error.to_string()))?;
    Ok(Retrained {
        version,
        kernel: known.kernel,
        this_kernel: kernel_name(),
        weights_sha256: known.weights_sha256,
        again_sha256: weights_sha256(&learned.weights),
        same_events: known.events_sha256 == hex::encode(stage.events_sha256),
    })
}

/// Lets a stage run through, and tells how far it is.
struct Told<'a>(&'a mut dyn FnMut(f64));

impl Observer for Told<'_> {
    fn updated(&mut self, progress: &Progress) -> bool {
        (self.0)(progress.share());
        true
    }
}
