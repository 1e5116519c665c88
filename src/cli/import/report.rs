//! What came of an import.

use std::io::Write;
use std::path::PathBuf;

use serde_json::{Map, Value, json};

use super::super::member::text;
use super::super::table::table;
use crate::lineage::ModelName;

/// Rejections of a file that a person is shown.
const SHOWN: usize = 5;

/// What came of a file.
pub(super) enum Outcome {
    /// A batch, with at least one event that was accepted or known.
    Taken(Map<String, Value>),
    /// A batch of rejections.
    Empty(Map<String, Value>),
    /// Nothing: `code`, `detail`, and where a server says so, `errors`.
    Refused(Value),
}

impl Outcome {
    /// Of a batch; `empty` when no event of it was accepted or known.
    pub(super) fn of_receipt(receipt: Map<String, Value>, empty: bool) -> Self {
        if empty { Self::Empty(receipt) } else { Self::Taken(receipt) }
    }

    pub(super) fn is_refusal(&self) -> bool {
        !matches!(self, Self::Taken(_))
    }

    fn receipt(&self) -> Option<&Map<String, Value>> {
        match self {
            Self::Taken(receipt) | Self::Empty(receipt) => Some(receipt),
            Self::Refused(_) => None,
        }
    }
}

/// What came of every file.
pub(super) struct Report<'a> {
    pub(super) model: &'a ModelName,
    pub(super) outcomes: &'a [(PathBuf, Outcome)],
}

impl Report<'_> {
    pub(super) fn print(&self, as_json: bool) -> anyhow::Result<()> {
        let mut out = std::io::stdout().lock();
        if as_json {
            let of_file = |(path, outcome): &(PathBuf, Outcome)| match outcome {
                Outcome::Refused(refused) => json!({"file": path, "taken": false, "refused": refused}),
                Outcome::Taken(receipt) => json!({"file": path, "taken": true, "receipt": receipt}),
                Outcome::Empty(receipt) => json!({"file": path, "taken": false, "receipt": receipt}),
            };
            let files: Vec<_> = self.outcomes.iter().map(of_file).collect();
            writeln!(out, "{}", serde_json::to_string_pretty(&json!({"model": self.model, "files": files}))?)?;
            return Ok(());
        }
        let rows = self.outcomes.iter().map(|(path, outcome)| {
            let counted = match outcome.receipt() {
                None => Default::default(),
                Some(receipt) => {
                    let [batch, accepted, duplicates, rejected, tasks] =
                        ["batch_id", "accepted", "duplicates", "rejected_count", "task_ids"]
                            .map(|name| text(&receipt[name]));
                    [batch, accepted, duplicates, rejected, text(&receipt["summary"]["steps"]), tasks]
                }
            };
            std::iter::once(path.display().to_string()).chain(counted).collect()
        });
        let head = ["FILE", "BATCH", "ACCEPTED", "DUPLICATES", "REJECTED", "STEPS", "TASKS"];
        writeln!(out, "into {}\n\n{}", self.model, table(&head, rows.collect()))?;
        for (path, outcome) in self.outcomes {
            for line in lines(outcome) {
                writeln!(out, "\n{}: {line}", path.display())?;
            }
        }
        Ok(out.flush()?)
    }
}

/// What else there is to say of a file.
fn lines(outcome: &Outcome) -> Vec<String> {
    let Some(receipt) = outcome.receipt() else {
        let Outcome::Refused(refused) = outcome else { return Vec::new() };
        let reasons = refused["errors"].as_array().into_iter().flatten().take(SHOWN);
        let told = std::iter::once(refused).chain(reasons);
        let told: Vec<_> = told.map(|why| format!("{}: {}", text(&why["code"]), text(&why["detail"]))).collect();
        return vec![format!("refused: {}", told.join("; "))];
    };
    let mut lines = Vec::new();
    if let Some(extraction) = receipt["summary"].get("extraction") {
        let [rows, vehicles, pairs, segments, events] =
            ["rows", "vehicles", "pairs", "segments", "events"].map(|name| text(&extraction[name]));
        let dropped = counts(&extraction["dropped_steps"]);
        lines.push(format!(
            "{events} events out of {segments} segments of {pairs} pairs, {vehicles} vehicles, {rows} rows; rows dropped: {dropped}; \
             segments ended by: {}",
            counts(&extraction["cut"])
        ));
    }
    let held = text(&receipt["held_sources"]);
    if !held.is_empty() {
        lines.push(format!("what came from {held} waits until it is released"));
    }
    let rejected = receipt["rejected"].as_array().map_or(&[][..], Vec::as_slice);
    for rejection in rejected.iter().take(SHOWN) {
        let place =
            ["pointer", "line", "row"].iter().find_map(|kind| Some(format!("{kind} {}", text(rejection.get(kind)?))));
        let (place, id) = (place.unwrap_or_default(), text(&rejection["event_id"]));
        lines.push(format!("rejected {id} ({place}): {}: {}", text(&rejection["code"]), text(&rejection["detail"])));
    }
    let more = receipt["rejected_count"].as_u64().unwrap_or(0).saturating_sub(SHOWN as u64);
    if more > 0 {
        lines.push(format!("{more} more were rejected; --json lists them"));
    }
    lines
}

/// Reasons and how often, the most frequent first.
fn counts(counts: &Value) -> String {
    let mut counts: Vec<_> = counts.as_object().into_iter().flatten().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(count.as_u64()));
    let told: Vec<_> = counts.into_iter().map(|(reason, count)| format!("{reason} {count}")).collect();
    if told.is_empty() { "none".to_owned() } else { told.join(", ") }
}
