//! Rows of one event into that event.

use std::borrow::Cow;
use std::collections::HashSet;
use std::rc::Rc;

use sha2::{Digest, Sha256};

use super::FormatError;
use super::cell::{Cell, Run, text_of};
use super::columns::Role;
use super::draft::Draft;
use super::excerpt::shortened;
use super::output::Output;
use super::raw::Origin;
use super::table::Table;
use crate::car_following::Extraction;
use crate::lineage::Place;

/// Collects rows; an event ends where the next one begins.
pub(super) struct Rows {
    roles: Rc<[Role]>,
    id_column: usize,
    current: Option<Current>,
    /// Digests of the ids of events that have ended, since ids may be long and many.
    ended: HashSet<[u8; 16]>,
}

struct Current {
    roles: Rc<[Role]>,
    /// As it stands in its rows; empty where they have none.
    id: String,
    draft: Draft,
    first_row: u64,
    steps: usize,
    texts: [Option<String>; 3],
}

impl Rows {
    pub(super) fn new(roles: Vec<Role>) -> Self {
        let id_column = roles.iter().position(|role| *role == Role::EventId).expect("a preset requires event_id");
        Self { roles: roles.into(), id_column, current: None, ended: HashSet::new() }
    }

    /// The event that row `number` belongs to; where it begins there, the one before is handed over.
    fn begin(&mut self, number: u64, id: Cell<'_>, output: &mut Output<'_, '_>) -> Result<&mut Current, FormatError> {
        let id = text_of(id);
        if self.current.as_ref().is_none_or(|current| current.id != id) {
            self.flush(output)?;
            if !self.ended.is_empty() && self.ended.contains(&digest(&id)) {
                let detail = format!("rows of event {:?} are not together", shortened(&id));
                return Err(FormatError::invalid(Place::Row(number), "rows_apart", detail));
            }
            let mut draft = Draft::default();
            draft.set_text("event_id", &id, output.limits.max_text_bytes);
            let (id, roles) = (id.into_owned(), Rc::clone(&self.roles));
            self.current = Some(Current { roles, id, draft, first_row: number, steps: 0, texts: [const { None }; 3] });
        }
        Ok(self.current.as_mut().expect("an event was just begun"))
    }

    /// Hands over the event whose rows have ended.
    fn flush(&mut self, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        let Some(current) = self.current.take() else { return Ok(()) };
        output.put(current.draft, Origin::Row(current.first_row))?;
        if !current.id.is_empty() {
            self.ended.insert(digest(&current.id));
        }
        Ok(())
    }
}

impl Table for Rows {
    fn id_column(&self) -> Option<usize> {
        Some(self.id_column)
    }

    fn row(&mut self, number: u64, cells: &[Cell<'_>], output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        self.begin(number, cells[self.id_column], output)?.step(cells, output);
        Ok(())
    }

    fn run(
        &mut self,
        number: u64,
        length: usize,
        columns: &[Run<'_>],
        output: &mut Output<'_, '_>,
    ) -> Result<(), FormatError> {
        let current = self.begin(number, columns[self.id_column].cell(0), output)?;
        if current.steps + length <= output.limits.max_steps as usize {
            current.run(length, columns, output);
            return Ok(());
        }
        for row in 0..length {
            let cells: Vec<_> = columns.iter().map(|column| column.cell(row)).collect();
            current.step(&cells, output);
        }
        Ok(())
    }

    /// Whatever event the row is of is refused.
    fn ragged(&mut self, _: u64, found: usize, wanted: usize) -> Result<(), FormatError> {
        if let Some(current) = &mut self.current {
            let step = current.steps.saturating_sub(1);
            current
                .draft
                .flaw(None, step, "wrong_cell_count", || format!("the row has {found} cells, the header {wanted}"));
        }
        Ok(())
    }

    fn end(mut self: Box<Self>, output: &mut Output<'_, '_>) -> Result<Option<Extraction>, FormatError> {
        self.flush(output)?;
        Ok(None)
    }
}

impl Current {
    fn step(&mut self, cells: &[Cell<'_>], output: &Output<'_, '_>) {
        let roles = Rc::clone(&self.roles);
        let step = self.steps;
        let max_steps = output.limits.max_steps as usize;
        if step == max_steps {
            self.draft.flaw(None, step, "too_many_steps", || format!("the event has more than {max_steps} steps"));
            return;
        }
        self.steps += 1;
        for (&role, &cell) in roles.iter().zip(cells) {
            match role {
                Role::EventId | Role::Ignored => {}
                Role::Source => self.text(0, role, cell, step, output.limits.max_text_bytes),
                Role::Run => self.text(1, role, cell, step, output.limits.max_text_bytes),
                Role::Split => self.text(2, role, cell, step, output.limits.max_text_bytes),
                _ => self.number(role, cell, step),
            }
        }
    }

    /// As [`Self::step`] of each of the rows, of which there are not too many: flaws are in the first if in any, since a
    /// column that can differ from row to row says the same in all of them.
    fn run(&mut self, length: usize, columns: &[Run<'_>], output: &Output<'_, '_>) {
        self.step(&columns.iter().map(|column| column.cell(0)).collect::<Vec<_>>(), output);
        self.steps += length - 1;
        for (&role, column) in Rc::clone(&self.roles).iter().zip(columns) {
            if let (Some(array), Run::Numbers(numbers)) = (self.array(role), column) {
                array.extend_from_slice(&numbers[1..]);
            }
        }
    }

    /// A column that says the same in every row of an event.
    fn text(&mut self, slot: usize, role: Role, cell: Cell<'_>, step: usize, max_bytes: u32) {
        let text = text_of(cell);
        match &self.texts[slot] {
            None => {
                self.draft.set_text(role.field(), &text, max_bytes);
                self.texts[slot] = Some(text.into_owned());
            }
            Some(first) if *first == text => {}
            Some(first) => differs(&mut self.draft, role, step, &shortened(&text), &shortened(first)),
        }
    }

    fn number(&mut self, role: Role, cell: Cell<'_>, step: usize) {
        let value = match cell {
            Cell::Number(value) => value,
            Cell::Missing if role == Role::Dt => return,
            Cell::Missing => {
                flawed(&mut self.draft, role, step, "missing_value", "is missing");
                0.0
            }
            Cell::Text(text) => text.parse().unwrap_or_else(|_| {
                let what = format!("is {:?}, not a number", shortened(text));
                flawed(&mut self.draft, role, step, "wrong_type", &what);
                0.0
            }),
        };
        if let Some(array) = self.array(role) {
            array.push(value);
            return;
        }
        match self.draft.recording.dt_s {
            None => self.draft.recording.dt_s = Some(value),
            Some(first) if first.to_bits() == value.to_bits() => {}
            Some(first) => differs(&mut self.draft, role, step, &value.to_string(), &first.to_string()),
        }
    }

    /// Where the numbers of a column go that has one for every step.
    fn array(&mut self, role: Role) -> Option<&mut Vec<f64>> {
        let recording = &mut self.draft.recording;
        match role {
            Role::Spacing => Some(&mut recording.spacing_m),
            Role::FollowerSpeed => Some(&mut recording.follower_speed_mps),
            Role::LeaderSpeed => Some(&mut recording.leader_speed_mps),
            Role::RelSpeed => Some(recording.rel_speed_mps.get_or_insert_default()),
            Role::Time => Some(recording.t_s.get_or_insert_default()),
            _ => None,
        }
    }
}

fn digest(id: &str) -> [u8; 16] {
    let whole: [u8; 32] = Sha256::digest(id.as_bytes()).into();
    *whole.first_chunk().expect("32 bytes")
}

fn flawed(draft: &mut Draft, role: Role, step: usize, code: &'static str, what: &str) {
    let field = role.field();
    draft.flaw(Cow::from(field), step, code, || format!("{field} at step {step} {what}"));
}

fn differs(draft: &mut Draft, role: Role, step: usize, value: &str, first: &str) {
    flawed(draft, role, step, "inconsistent_rows", &format!("is {value:?}, and {first:?} in the event's first row"));
}
