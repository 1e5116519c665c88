//! What a replay of a line came to.

use serde::{Deserialize, Serialize};

use super::{PromotionDecision, RegimeName, TaskState, TestMeasures};

/// A stage of the line that a replay learns again: a task of its own.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct ReplayPart {
    /// The task.
    pub task_id: i64,
    /// Where it stands.
    pub state: TaskState,
    /// Share done at its last checkpoint, 0–1.
    pub checkpointed: f64,
}

/// Before and after a replay: the head that had learned what was retracted, and the one that never saw it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReplayReport {
    /// The head before; none where nothing was learned.
    pub before: Option<i64>,
    /// The head after; none where nothing was left to learn.
    pub after: Option<i64>,
    /// Versions whose stage was to be learned again, in their order.
    pub stages: Vec<ReplayedStage>,
    /// Both heads on the same test events, regime by regime.
    pub regimes: Vec<ReplayedRegimes>,
    /// What became of the live version.
    pub live: ReplayedLive,
}

/// A version and what replaced it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReplayedStage {
    /// The version.
    pub version: i64,
    /// The regime it learned.
    pub regime: RegimeName,
    /// The version that learned the same but for what was retracted; none where nothing was left for training, or its task
    /// made none.
    pub replayed_as: Option<i64>,
}

/// One regime before and after; measures are none without test events, or where there was no network to drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReplayedRegimes {
    /// The regime.
    pub regime: RegimeName,
    /// By the head before.
    pub before: Option<TestMeasures>,
    /// By the head after.
    pub after: Option<TestMeasures>,
}

/// The live version at the end of a replay.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReplayedLive {
    /// What served until then.
    pub from: Option<i64>,
    /// What serves from then on.
    pub to: Option<i64>,
    /// Whether what serves from then on has learned what was retracted, from this batch or another.
    pub tainted: bool,
    /// What the policy decided.
    pub decision: PromotionDecision,
    /// For a person.
    pub reason: String,
}
