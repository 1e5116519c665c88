//! Tasks and sides of events from a file.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, bail, ensure};

use crate::lineage::Split;

/// Names shown of events that are missing.
const SHOWN: usize = 3;

/// One row of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Listed {
    pub(super) event_id: String,
    pub(super) task: String,
    pub(super) split: Split,
}

/// The rows of the file.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<Listed>> {
    let mut reader = csv::Reader::from_path(path)?;
    let headers = reader.headers()?.clone();
    ensure!(!headers.is_empty(), "it is empty");
    let column = |name: &str| {
        let found: Vec<_> = headers.iter().map(str::trim).collect();
        let place = found.iter().position(|header| *header == name);
        place.with_context(|| format!("column {name} is missing; it has {}", found.join(", ")))
    };
    let (id, task, split) = (column("event_id")?, column("task")?, column("split")?);
    let mut rows = Vec::new();
    for (number, row) in reader.records().enumerate() {
        let row = row?;
        let at = |column: usize| row.get(column).unwrap_or_default().trim();
        let row_number = number + 1;
        let side = at(split);
        let Some(side) = Split::parse(side) else {
            bail!("row {row_number}: split {side:?} is none of train, validation and test");
        };
        ensure!(!at(id).is_empty() && !at(task).is_empty(), "row {row_number}: event_id or task is empty");
        rows.push(Listed { event_id: at(id).to_owned(), task: at(task).to_owned(), split: side });
    }
    ensure!(!rows.is_empty(), "it lists no event");
    let task = &rows[0].task;
    ensure!(
        rows.iter().any(|row| row.task != *task),
        "all its events are of task {task}: two tasks are needed at least"
    );
    Ok(rows)
}

/// The place of each listed event among `names`; `left_out` tells which events are not there, and why.
pub(super) fn places(rows: &[Listed], names: &[&str], left_out: &str) -> anyhow::Result<Vec<usize>> {
    let mut place: HashMap<&str, Vec<usize>> = HashMap::new();
    for (at, name) in names.iter().enumerate() {
        place.entry(name).or_default().push(at);
    }
    let absent: Vec<_> = rows.iter().map(|row| row.event_id.as_str()).filter(|id| !place.contains_key(id)).collect();
    if !absent.is_empty() {
        let shown = absent.iter().take(SHOWN).copied().collect::<Vec<_>>().join(", ");
        let more = if absent.len() > SHOWN { ", …" } else { "" };
        let of = rows.len();
        let absent = absent.len();
        bail!("{absent} of its {of} events are not among those of --events that can be used: {shown}{more}{left_out}");
    }
    let mut places = Vec::with_capacity(rows.len());
    let mut listed = std::collections::HashSet::new();
    for row in rows {
        let id = row.event_id.as_str();
        ensure!(listed.insert(id), "it lists event {id} twice");
        match place[id].as_slice() {
            [one] => places.push(*one),
            _ => bail!("event {id} is in --events several times, with different contents"),
        }
    }
    Ok(places)
}
