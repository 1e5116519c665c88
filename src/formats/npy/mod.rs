//! NumPy's `.npy` as FollowNet ships its events: an array of shape (events, 4), whose cells are the columns of an event, each a
//! list or an array of its own length; or (events, 4, steps) where all are as long. The columns are, in this order, spacing,
//! follower speed, relative speed and leader speed.
//!
//! The format is described at <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>. An array of objects is
//! a pickle, of which [`pickle`] reads lists, numbers and arrays and nothing else. The format has no names: an event is called
//! by its place in the array.

/// What arrays are of.
mod element;
/// What is wrong with a pickle.
mod flaw;
/// What stands before the array.
mod header;
/// A pickle's bytes.
mod input;
/// Arrays of objects.
mod pickle;
/// What a pickle makes.
mod value;

use std::io::{self, BufRead, Read};

use super::FormatError;
use super::draft::Draft;
use super::output::Output;
use super::raw::Origin;
use super::source::Budget;
use crate::lineage::Place;
use element::Element;
use header::Header;

/// Columns of an event.
const COLUMNS: usize = 4;

/// Decodes an array event by event.
pub(super) fn decode(
    mut reader: Box<dyn BufRead>,
    budget: &Budget,
    output: &mut Output<'_, '_>,
) -> Result<(), FormatError> {
    let Header { element, shape } = Header::read(&mut reader)?;
    let limits = output.limits;
    let rows = events(element, &shape, limits.max_events)?;
    let mut events = Events { output, columns: Vec::with_capacity(COLUMNS) };
    if let Some(&steps) = shape.get(2) {
        for _ in 0..rows {
            budget.next_event();
            for _ in 0..COLUMNS {
                let column = element.column(&mut reader, steps, limits.max_steps)?;
                events.column(column)?;
            }
        }
    } else {
        let cells = pickle::decode(&mut reader, rows, budget, limits, &mut |column| events.column(column))?;
        if cells != rows * COLUMNS as u64 {
            let detail = format!("the array has {cells} cells, its header says {rows} × {COLUMNS}");
            return Err(FormatError::malformed(None, &detail));
        }
    }
    match reader.read(&mut [0])? {
        0 => Ok(()),
        _ => Err(FormatError::malformed(None, &"bytes come after the array")),
    }
}

/// How many events an array of this shape has.
fn events(element: Element, shape: &[u64], max_events: u32) -> Result<u64, FormatError> {
    let rows = match (element, shape) {
        (Element::Object, &[rows, 4]) => Some(rows),
        (Element::Object, _) => None,
        (_, &[rows, 4, steps]) if steps > 0 => Some(rows),
        _ => None,
    };
    let rows = rows.ok_or_else(|| {
        let detail = format!(
            "an array of {element} has shape {shape:?}; FollowNet's have objects and shape (events, 4), or numbers and \
             (events, 4, steps)"
        );
        FormatError::invalid(whole(), "wrong_shape", detail)
    })?;
    if rows > u64::from(max_events) {
        let detail = format!("the array holds {rows} events, at most {max_events} are read");
        return Err(FormatError::TooLarge { code: "too_many_events", detail });
    }
    Ok(rows)
}

/// A column of an event, and how long it is: more numbers than an event may have are counted, not kept.
#[derive(Debug, Default)]
struct Column {
    numbers: Vec<f64>,
    length: u64,
}

impl Column {
    /// One number more; whether it is kept.
    fn push(&mut self, number: f64, most: u32) -> bool {
        self.length += 1;
        let is_kept = self.length <= u64::from(most);
        if is_kept {
            self.numbers.push(number);
        }
        is_kept
    }
}

/// Makes events of columns.
struct Events<'e, 'a, 's> {
    output: &'e mut Output<'a, 's>,
    columns: Vec<Column>,
}

impl Events<'_, '_, '_> {
    fn column(&mut self, column: Column) -> Result<(), FormatError> {
        self.columns.push(column);
        if self.columns.len() < COLUMNS {
            return Ok(());
        }
        let mut draft = Draft::default();
        let (number, limits) = (self.output.next(), self.output.limits);
        draft.set_text("event_id", &number.to_string(), limits.max_text_bytes);
        if self.columns.iter().any(|column| column.length > u64::from(limits.max_steps)) {
            let max_steps = limits.max_steps;
            draft.flaw(None, None, "too_many_steps", || format!("the event has more than {max_steps} steps"));
        }
        let mut columns = self.columns.drain(..).map(|column| column.numbers);
        let mut next = || columns.next().unwrap_or_default();
        draft.recording.spacing_m = next();
        draft.recording.follower_speed_mps = next();
        draft.recording.rel_speed_mps = Some(next());
        draft.recording.leader_speed_mps = next();
        drop(columns);
        self.output.put(draft, Origin::Entry(number))
    }
}

/// The place of the array as a whole.
fn whole() -> Place {
    Place::Pointer(String::new())
}

/// The next bytes.
fn bytes<const N: usize>(reader: &mut (impl Read + ?Sized)) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    reader.read_exact(&mut bytes)?;
    Ok(bytes)
}
