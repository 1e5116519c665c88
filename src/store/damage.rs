//! Versions that were found corrupt since the process began: what is reported, never served.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::Store;

/// What was found, by model and version, of no more versions than are remembered.
#[derive(Debug)]
pub(super) struct Damage {
    most: usize,
    found: Mutex<BTreeMap<(i64, i64), String>>,
}

impl Damage {
    pub(super) fn new(most: usize) -> Self {
        Self { most, found: Mutex::default() }
    }

    fn found(&self) -> MutexGuard<'_, BTreeMap<(i64, i64), String>> {
        // Whole between any two of its calls.
        self.found.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Store {
    /// Remembers that a version is corrupt, and how.
    pub fn note_corrupt(&self, model_id: i64, version: i64, detail: impl Into<String>) {
        let mut found = self.damage.found();
        if found.len() < self.damage.most {
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

#[cfg(test)]
mod tests {
    use crate::store::fixture::settings;
    use crate::store::{Store, StoreSettings};

    #[tokio::test]
    async fn no_more_corrupt_versions_are_remembered_than_the_settings_say() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::open(&StoreSettings { corrupt_versions: 2, ..settings(&directory) }).await.unwrap();
        for version in 1..=3 {
            store.note_corrupt(1, version, "a bit has flipped");
        }
        assert_eq!(store.corrupt_versions(1), 2);
        assert_eq!(store.corruption(1, 2).as_deref(), Some("a bit has flipped"));
        assert_eq!(store.corruption(1, 3), None);
    }
}
