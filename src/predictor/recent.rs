//! The versions somebody named lately, a bounded number of them.

use std::collections::VecDeque;
use std::sync::Arc;

use super::Loaded;

/// Least recently used first.
#[derive(Debug)]
pub(super) struct Recent {
    most: usize,
    versions: VecDeque<(i64, Arc<Loaded>)>,
}

impl Recent {
    pub(super) fn new(most: usize) -> Self {
        Self { most, versions: VecDeque::new() }
    }

    pub(super) fn get(&mut self, model_id: i64, version: i64) -> Option<Arc<Loaded>> {
        let at = self.versions.iter().position(|(model, loaded)| *model == model_id && loaded.version() == version)?;
        let found = self.versions.remove(at)?;
        let loaded = Arc::clone(&found.1);
        self.versions.push_back(found);
        Some(loaded)
    }

    pub(super) fn forget(&mut self, model_id: i64, version: i64) {
        self.versions.retain(|(model, loaded)| (*model, loaded.version()) != (model_id, version));
    }

    pub(super) fn put(&mut self, model_id: i64, loaded: Arc<Loaded>) {
        let already = self.get(model_id, loaded.version()).is_some();
        if !already {
            self.versions.push_back((model_id, loaded));
        }
        while self.versions.len() > self.most {
            self.versions.pop_front();
        }
    }
}
