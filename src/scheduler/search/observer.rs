//! What a stage of a search tells, as a part of the whole task.

use super::super::observer::JobObserver;
use super::super::running::SearchPlace;
use super::state::SearchState;
use crate::training::{Interim, Observer, Progress};

/// Passes on what one stage of the search tells.
pub(super) struct SearchObserver<'a> {
    pub(super) job: &'a mut JobObserver,
    /// What was measured before this stage.
    pub(super) state: &'a SearchState,
    pub(super) place: SearchPlace,
}

impl SearchObserver<'_> {
    /// Every stage counts alike, and what is measured between them not at all.
    fn share(&self, progress: &Progress) -> f64 {
        (f64::from(self.place.learning - 1) + progress.share()) / f64::from(self.place.of)
    }
}

impl Observer for SearchObserver<'_> {
    fn updated(&mut self, progress: &Progress) -> bool {
        self.job.tell(self.share(progress), progress, Some(self.place))
    }

    fn evaluated(&mut self, interim: &Interim) {
        self.job.evaluated(interim);
    }

    fn wants_stop(&mut self) -> bool {
        self.job.wants_stop()
    }

    fn wants_checkpoint(&mut self) -> bool {
        self.job.wants_checkpoint()
    }

    fn checkpoint(&mut self, progress: &Progress, state: Vec<u8>) {
        self.job.save(self.share(progress), &self.state.to_bytes(&state));
    }
}
