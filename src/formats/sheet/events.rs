//! Stored events as uploads take them: rows of a table, a step each, or lines of JSON.

use std::collections::HashSet;
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::sync::Arc;

use serde::Serialize;

use super::{Cells, Sheet, SheetFormat, SheetWriter};
use crate::lineage::StoredEvent;

/// Writes stored events piece by piece.
#[derive(Debug)]
pub struct EventWriter(Form);

#[derive(Debug)]
enum Form {
    Lines,
    Sheet { writer: SheetWriter, names: Names, begun: bool },
}

impl EventWriter {
    /// Lines of JSON, or a table.
    ///
    /// # Errors
    /// When the columns cannot be said.
    pub fn new(table: Option<SheetFormat>) -> io::Result<Self> {
        let Some(format) = table else { return Ok(Self(Form::Lines)) };
        let mut names = Names::default();
        let writer = SheetWriter::new(format, &event_sheet(&[], &mut names))?;
        Ok(Self(Form::Sheet { writer, names, begun: false }))
    }

    /// The bytes of these events.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn write(&mut self, events: &[StoredEvent]) -> io::Result<Vec<u8>> {
        match &mut self.0 {
            Form::Lines => event_lines(events),
            // A table without rows has its columns all the same.
            Form::Sheet { begun: true, .. } if events.is_empty() => Ok(Vec::new()),
            Form::Sheet { writer, names, begun } => {
                *begun = true;
                writer.write(&event_sheet(events, names))
            }
        }
    }

    /// The last bytes.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn end(self) -> io::Result<Vec<u8>> {
        match self.0 {
            Form::Lines => Ok(Vec::new()),
            Form::Sheet { writer, .. } => writer.end(),
        }
    }
}

/// Names that were given in a table, where rows with the same one are one event: whoever comes later under a name is told
/// apart by a number.
#[derive(Debug, Default)]
struct Names {
    given: HashSet<u64>,
    hasher: RandomState,
    events: u64,
}

impl Names {
    /// Only digests of names are kept: a name may be changed for no need, and no two are the same.
    fn give(&mut self, name: &str) -> Arc<str> {
        self.events += 1;
        if self.given.insert(self.hasher.hash_one(name)) {
            return name.into();
        }
        let mut other = format!("{name}#{}", self.events);
        while !self.given.insert(self.hasher.hash_one(&other)) {
            other.push('#');
        }
        other.into()
    }
}

/// The events as rows under the names of the JSON event.
fn event_sheet(events: &[StoredEvent], names: &mut Names) -> Sheet {
    let rows = events.iter().map(|stored| stored.event.steps()).sum();
    let mut texts: [Vec<Option<Arc<str>>>; 4] = std::array::from_fn(|_| Vec::with_capacity(rows));
    let (mut dt_s, mut spacing) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
    let (mut follower, mut leader) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
    for StoredEvent { event_id, source, run, split, event } in events {
        let told = [
            Some(names.give(event_id)),
            source.as_deref().map(Arc::from),
            run.as_deref().map(Arc::from),
            Some(Arc::from(split.as_str())),
        ];
        for (cells, told) in texts.iter_mut().zip(told) {
            cells.extend(std::iter::repeat_n(told, event.steps()));
        }
        dt_s.extend(std::iter::repeat_n(Some(event.dt_s()), event.steps()));
        spacing.extend_from_slice(event.spacing_m());
        follower.extend_from_slice(event.follower_speed_mps());
        leader.extend_from_slice(event.leader_speed_mps());
    }
    let [event_id, source, run, split] = texts.map(Cells::Text);
    Sheet::default()
        .with("event_id", event_id)
        .with("source", source)
        .with("run", run)
        .with("split", split)
        .with("dt_s", Cells::Number(dt_s))
        .with("spacing_m", Cells::Single(spacing))
        .with("follower_speed_mps", Cells::Single(follower))
        .with("leader_speed_mps", Cells::Single(leader))
}

/// An event as uploads take it.
#[derive(Serialize)]
struct Line<'a> {
    event_id: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    source: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    run: Option<&'a str>,
    split: &'a str,
    dt_s: f64,
    spacing_m: &'a [f32],
    follower_speed_mps: &'a [f32],
    leader_speed_mps: &'a [f32],
}

/// The events, one a line.
fn event_lines(events: &[StoredEvent]) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    for StoredEvent { event_id, source, run, split, event } in events {
        let line = Line {
            event_id,
            source: source.as_deref(),
            run: run.as_deref(),
            split: split.as_str(),
            dt_s: event.dt_s(),
            spacing_m: event.spacing_m(),
            follower_speed_mps: event.follower_speed_mps(),
            leader_speed_mps: event.leader_speed_mps(),
        };
        serde_json::to_writer(&mut bytes, &line)?;
        bytes.push(b'\n');
    }
    Ok(bytes)
}
