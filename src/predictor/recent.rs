//! The versions somebody named lately, a bounded number of them.

use std::collections::VecDeque;
use std::sync::Arc;

use super::Loaded;

/// Least recently used first.
#[derive(Debug)]
pub(super) struct Recent {
    most: usize,
    versions: VecDeque<(i64, Arc<Loaded>)>,
    /// How often one was let go of.
    forgotten: u64,
}

impl Recent {
    pub(super) fn new(most: usize) -> Self {
        Self { most, versions: VecDeque::new(), forgotten: 0 }
    }

    pub(super) fn get(&mut self, model_id: i64, version: i64) -> Option<Arc<Loaded>> {
        let at = self.versions.iter().position(|(model, loaded)| *model == model_id && loaded.version() == version)?;
        let found = self.versions.remove(at)?;
        let loaded = Arc::clone(&found.1);
        self.versions.push_back(found);
        Some(loaded)
    }

    /// To be read before a version is loaded and given to [`Self::put`] with it.
    pub(super) fn forgotten(&self) -> u64 {
        self.forgotten
    }

    pub(super) fn forget(&mut self, model_id: i64, version: i64) {
        self.forgotten += 1;
        self.versions.retain(|(model, loaded)| (*model, loaded.version()) != (model_id, version));
    }

    /// Keeps a version, but for one that may have been let go of since it was read.
    pub(super) fn put(&mut self, model_id: i64, loaded: Arc<Loaded>, forgotten: u64) {
        if self.forgotten != forgotten {
            return;
        }
        let already = self.get(model_id, loaded.version()).is_some();
        if !already {
            self.versions.push_back((model_id, loaded));
        }
        while self.versions.len() > self.most {
            self.versions.pop_front();
        }
    }
}
