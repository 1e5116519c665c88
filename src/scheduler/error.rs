//! Why a learn job wrote no version.

use crate::lineage::TaskError;
use crate::store::StoreError;
use crate::training::LearnError;

/// Why a job wrote no version.
#[derive(Debug, thiserror::Error)]
pub(super) enum JobError {
    /// The task was asked to stop.
    #[error("stopped")]
    Stopped,
    /// Its client is told why.
    #[error("{}", .0.detail)]
    Failed(TaskError),
    /// The store failed.
    #[error(transparent)]
    Store(StoreError),
    /// A bug.
    #[error("panicked: {0}")]
    Panicked(String),
}

impl From<StoreError> for JobError {
    fn from(error: StoreError) -> Self {
        match error {
            // Nothing is learned from what is not what was written.
            StoreError::Corrupt { part, detail } => Self::Failed(TaskError { code: part.code().to_owned(), detail }),
            error => Self::Store(error),
        }
    }
}

impl From<LearnError> for JobError {
    fn from(error: LearnError) -> Self {
        let code = match &error {
            LearnError::Stopped => return Self::Stopped,
            LearnError::NoTrainingEvents => "no_training_events",
            LearnError::Diverged { .. } => "diverged",
            LearnError::Checkpoint(detail) => return StoreError::malformed("checkpoint", detail).into(),
        };
        Self::Failed(TaskError { code: code.to_owned(), detail: error.to_string() })
    }
}

impl From<tokio::task::JoinError> for JobError {
    fn from(error: tokio::task::JoinError) -> Self {
        Self::Panicked(error.to_string())
    }
}
