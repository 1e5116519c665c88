//! Recordings of a whole road, every vehicle at every time: events are extracted out of them.

/// SUMO's floating-car data, in order of time.
mod fcd;
/// What a row says of where it belongs.
mod labels;
/// NGSIM, in order of vehicles.
mod ngsim;
/// How much of a road is in memory.
mod room;
/// Floating-car data as XML.
mod xml;

pub(super) use fcd::Fcd;
pub(super) use ngsim::Ngsim;
pub(super) use xml::decode;

use super::FormatError;
use super::cell::Cell;
use super::columns::Role;
use super::draft::Draft;
use super::excerpt::shortened;
use super::output::Output;
use super::raw::Origin;
use crate::car_following::Segment;
use crate::lineage::Place;
use labels::Label;

/// Where events of a follower go.
struct Names<'a> {
    follower: &'a str,
    leader: &'a str,
    /// When it begins, as the recording counts.
    at: &'a str,
    label: &'a Label,
}

/// Hands over an event. It is called after follower, leader and beginning; pieces of one follower's way are one run, so that
/// they are on one side of the split, unless the rows name a run.
fn put<L>(segment: Segment<L>, names: &Names<'_>, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
    let Names { follower, leader, at, label } = names;
    let max_bytes = output.limits.max_text_bytes;
    let mut draft = Draft::default();
    let road = if label.source().is_empty() { String::new() } else { format!("{}/", label.source()) };
    draft.set_text("event_id", &format!("{road}{follower}>{leader}@{at}"), max_bytes);
    draft.set_text("source", label.source(), max_bytes);
    draft.set_text("run", if label.run().is_empty() { follower } else { label.run() }, max_bytes);
    draft.set_text("split", label.split(), max_bytes);
    let origin = Origin::Among(segment.first_row);
    draft.recording = segment.into_recording();
    output.put(draft, origin)
}

/// A cell's number, if it has one.
///
/// # Errors
/// When it is none, or not finite.
fn number(cell: Cell<'_>, role: Role, row: u64) -> Result<Option<f64>, FormatError> {
    let number = match cell {
        Cell::Missing => return Ok(None),
        Cell::Number(number) => number,
        Cell::Text(text) => text.parse().unwrap_or(f64::NAN),
    };
    if number.is_finite() {
        return Ok(Some(number));
    }
    let shown = match cell {
        Cell::Text(text) => format!("{:?}", shortened(text)),
        _ => number.to_string(),
    };
    Err(flaw(row, "wrong_type", format!("{} in row {row} is {shown}, not a number", role.field())))
}

/// A cell's number.
///
/// # Errors
/// When it has none.
fn needed(cell: Cell<'_>, role: Role, row: u64) -> Result<f64, FormatError> {
    let missing = || flaw(row, "missing_value", format!("{} in row {row} is missing", role.field()));
    number(cell, role, row)?.ok_or_else(missing)
}

fn flaw(row: u64, code: &'static str, detail: String) -> FormatError {
    FormatError::invalid(Place::Row(row), code, detail)
}

fn ragged(row: u64, found: usize, wanted: usize) -> FormatError {
    flaw(row, "wrong_cell_count", format!("row {row} has {found} cells, the header {wanted}"))
}
