//! A task that finds its own strength: the stage once without a penalty and once with every strength that is tried, each
//! from the parent, each driven on validation events; then once more with the best.
//!
//! The same bits come out whatever happens on the way: what was measured is part of the task's checkpoint, and the stage
//! under way goes on from its own.

mod observer;
mod seen;
mod state;

use self::observer::SearchObserver;
pub(super) use self::seen::not_searched;
use self::seen::{Seen, record};
pub use self::state::SearchState;
use self::state::{Row, fingerprint};
use super::handle::Inner;
use super::observer::JobObserver;
use super::running::SearchPlace;
use super::stage::{Stage, Validated};
use crate::consolidation::{Method, searched_strengths};
use crate::driver::Scaling;
use crate::lineage::StrengthSearch;
use crate::training::{LearnError, Learned, Observer, StageInput};

/// Stages that a search learns: one without a penalty, the candidates, and the one that is kept.
const STAGES: u32 = 7;

/// Why these events cannot tell a strength; none when they can.
pub(super) fn hindrance(validated: &[Validated]) -> Option<&'static str> {
    let (new, earlier) = validated.split_last()?;
    if new.events.is_empty() {
        return Some("the task has no validation events, so the default strength is used");
    }
    let blind = !earlier.is_empty() && earlier.iter().all(|of| of.events.is_empty());
    blind.then_some("no regime learned earlier has validation events, so the default strength is used")
}

/// Finds the strength of a stage, from the task's last checkpoint on, and learns the stage with it.
pub(super) fn learn(
    inner: &Inner,
    stage: &Stage,
    validated: &[Validated],
    checkpoint: Option<&[u8]>,
    observer: &mut JobObserver,
) -> Result<(Learned, StrengthSearch), LearnError> {
    let fingerprint = fingerprint(&stage.input(), validated);
    let state = checkpoint.map_or_else(
        || SearchState::begin(fingerprint),
        |bytes| {
            SearchState::from_bytes(bytes, fingerprint).unwrap_or_else(|detail| {
                tracing::warn!(
                    task_id = stage.task.task_id,
                    detail,
                    "a checkpoint does not fit; the search starts afresh"
                );
                SearchState::begin(fingerprint)
            })
        },
    );
    Search { inner, stage, validated, observer, state }.finish()
}

/// A search under way.
struct Search<'a> {
    inner: &'a Inner,
    stage: &'a Stage,
    /// Regimes learned earlier, then the new one.
    validated: &'a [Validated],
    observer: &'a mut JobObserver,
    state: SearchState,
}

impl Search<'_> {
    fn finish(mut self) -> Result<(Learned, StrengthSearch), LearnError> {
        let (stage, strengths) = (self.stage, searched_strengths(self.stage.model.method));
        let place = |learning, strength| SearchPlace { learning, of: STAGES, strength };
        if self.state.rows.is_empty() {
            let parent = stage.parent.as_ref().expect("a stage that searches continues a version");
            let row = self.measure(&parent.scaling, &parent.weights)?;
            self.add(row);
        }
        if self.state.rows.len() == 1 {
            let row = self.row(&unpenalised(stage.input()), place(1, 0.0))?;
            self.add(row);
        }
        for (learning, strength) in (2..).zip(strengths).skip(self.state.rows.len() - 2) {
            let row = self.row(&with(stage.input(), strength), place(learning, strength))?;
            self.add(row);
        }
        let seen = Seen::of(&self.state.rows, &strengths);
        let Some(strength) = seen.chosen() else { return Err(self.divergence()) };
        let input = StageInput { validation: stage.input().validation, ..with(stage.input(), strength) };
        let learned = self.learn(&input, place(STAGES, strength))?;
        Ok((learned, record(stage, self.validated, &seen, strength)))
    }

    /// Learns the stage as `input` says and measures what came of it.
    fn row(&mut self, input: &StageInput<'_>, place: SearchPlace) -> Result<Row, LearnError> {
        match self.learn(input, place) {
            Ok(learned) => self.measure(&learned.scaling, &learned.weights),
            Err(LearnError::Diverged { update, detail }) => {
                let (task_id, strength) = (self.stage.task.task_id, place.strength);
                tracing::warn!(task_id, strength, detail, "a strength diverged and is out of the search");
                Ok(Row::Diverged { update, detail })
            }
            Err(error) => Err(error),
        }
    }

    /// From the checkpoint of the stage under way, if there is one.
    fn learn(&mut self, input: &StageInput<'_>, place: SearchPlace) -> Result<Learned, LearnError> {
        let resume = self.state.stage.take();
        let mut observer = SearchObserver { job: self.observer, state: &self.state, place };
        self.inner.learn_or_afresh(self.stage.task.task_id, input, resume.as_deref(), &mut observer)
    }

    /// Drives the validation events of every regime. Stopped on the way, the task goes on from its last checkpoint.
    fn measure(&mut self, scaling: &Scaling, weights: &[f32]) -> Result<Row, LearnError> {
        let shape = self.stage.settings.shape();
        let mut errors = Vec::with_capacity(self.validated.len());
        for of in self.validated {
            if self.observer.wants_stop() {
                return Err(LearnError::Stopped);
            }
            errors.push(self.inner.learner.evaluate(shape, scaling, weights, &of.events, &self.inner.workers));
        }
        Ok(Row::Measured(errors))
    }

    /// Keeps what was measured, whatever happens from here.
    fn add(&mut self, row: Row) {
        self.state.rows.push(row);
        let stages = self.state.rows.len() as f64 - 1.0;
        self.observer.save(stages / f64::from(STAGES), &self.state.to_bytes(&[]));
    }

    /// Why there is no strength to choose.
    fn divergence(&self) -> LearnError {
        let last = self.state.rows.iter().rev().find_map(Row::divergence);
        last.unwrap_or_else(|| LearnError::Diverged { update: 0, detail: "no strength could be measured".to_owned() })
    }
}

/// The stage as `naive` learns it, without telling how it drives on the way.
fn unpenalised(input: StageInput<'_>) -> StageInput<'_> {
    StageInput { method: Method::Naive, memory: &[], replay: &[], validation: &[], ..input }
}

/// The stage with this strength, without telling how it drives on the way.
fn with(input: StageInput<'_>, strength: f64) -> StageInput<'_> {
    let mut input = StageInput { validation: &[], ..input };
    input.settings.strength = Some(strength);
    input
}
