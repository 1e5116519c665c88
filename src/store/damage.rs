//! Versions that were found corrupt since the process began: what is reported, never served.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::Store;

/// Most versions that are remembered. A database with more of them is of no use as it is; `headway verify` lists all.
const MOST: usize = 1000;

/// What was found, by model and version.
#[derive(Debug, Default)]
pub(super) struct Damage(Mutex<BTreeMap<(i64, i64), String>>);

impl Damage {
    fn found(&self) -> MutexGuard<'_, BTreeMap<(i64, i64), String>> {
        // Whole between any two of its calls.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Store {
    /// Remembers that a version is corrupt, and how.
    pub fn note_corrupt(&self, model_id: i64, version: i64, detail: impl Into<String>) {
        let mut found = self.damage.found();
        if found.len() < MOST {
            found.entry((model_id, version)).or_insert_with(|| detail.into());
        }
    }

    /// How the version was found corrupt, if it was.
    #[must_use]
    pub fn corruption(&self, model_id: i64, version: i64) -> Option<String> {
        self.damage.found().get(&(model_id, version)).cloned()
    }

    /// How many versions of the model were found corrupt.
    #[must_use]
    pub fn corrupt_versions(&self, model_id: i64) -> usize {
        self.damage.found().range((model_id, i64::MIN)..=(model_id, i64::MAX)).count()
    }
}
