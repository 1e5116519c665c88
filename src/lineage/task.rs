//! The durable job that learns one regime from batches.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{RegimeName, ReplayPart, ReplayReport};

/// Where a task stands. The last three are final.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TaskState {
    /// Waits in its model's order.
    Queued,
    /// Learns, or waits for its process to come back.
    Running,
    /// Wrote a version.
    Succeeded,
    /// Wrote none; its events are held.
    Failed,
    /// Wrote none; its events are set aside.
    Cancelled,
}

impl TaskState {
    /// The name on the wire and in the database.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// Whether nothing will change it any more.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }
}

/// What a task is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TaskKind {
    /// Learns a stage.
    Learn,
    /// Comes after the tasks that learn a line again, and measures what came of them.
    Replay,
}

/// Why a task failed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TaskError {
    /// Stable name: `no_training_events`, `diverged`, `too_many_regimes`, `internal`.
    pub code: String,
    /// For a person.
    pub detail: String,
}

/// A task as stored. Progress of a running one is kept in memory beside it.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// Its id; `t7` on the wire.
    pub task_id: i64,
    /// The model's row id.
    pub model_id: i64,
    /// What it is for.
    pub kind: TaskKind,
    /// Where it stands.
    pub state: TaskState,
    /// The regime it learns.
    pub regime: RegimeName,
    /// Overrides of the model's settings: a JSON object or null.
    pub settings: Value,
    /// The batches its events came in, ascending.
    pub batches: Vec<i64>,
    /// The version it starts from, once it has started; none at stage 1.
    pub parent: Option<i64>,
    /// Its stage, once it has started.
    pub stage: Option<u32>,
    /// Its outcome.
    pub version: Option<i64>,
    /// How often it was started or resumed.
    pub attempt: u32,
    /// Share done at its last checkpoint, 0–1.
    pub checkpointed: f64,
    /// The replay it is a part of.
    pub part_of: Option<i64>,
    /// Of a part: the version whose stage it learns again.
    pub replays: Option<i64>,
    /// Of a replay: its parts, in their order.
    pub parts: Vec<ReplayPart>,
    /// Of a replay that has ended: what came of it.
    pub report: Option<ReplayReport>,
    /// Why it failed.
    pub error: Option<TaskError>,
    /// When it was asked for.
    pub created_at: Timestamp,
    /// When it first started.
    pub started_at: Option<Timestamp>,
    /// When it ended.
    pub ended_at: Option<Timestamp>,
}
