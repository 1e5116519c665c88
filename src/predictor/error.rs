//! Why a prediction is not answered.

use crate::store::StoreError;

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum PredictError {
    /// Nothing is live.
    #[error("the model has no live version")]
    NoLiveVersion,
    /// The model has no such version.
    #[error("the model has no version {0}")]
    UnknownVersion(i64),
    /// The version's weights were not kept.
    #[error("version {0} is pruned: retention did not keep its weights")]
    Pruned(i64),
    /// The version is corrupt; it is never served.
    #[error("version {0} is corrupt")]
    Unusable(i64),
    /// A window is not what the version reads.
    #[error("window {window}: {member} holds {found} steps, exactly {horizon} are needed")]
    WindowLength {
        /// Its index in the request.
        window: usize,
        /// Which array.
        member: &'static str,
        /// Its length.
        found: usize,
        /// The version's horizon.
        horizon: usize,
    },
    /// A value of a window is not a finite number.
    #[error("window {window}: {member}[{step}] is not finite")]
    NotFinite {
        /// Its index in the request.
        window: usize,
        /// Which array.
        member: &'static str,
        /// The step.
        step: usize,
    },
    /// As much waits as may.
    #[error("as many windows as may wait to be computed do")]
    Busy,
    /// The database failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A bug.
    #[error("a prediction panicked")]
    Panicked,
}
