//! Rows of one event into that event.

use std::borrow::Cow;
use std::collections::HashSet;

use super::FormatError;
use super::columns::Role;
use super::draft::{Draft, shortened};
use super::output::Output;
use super::raw::Origin;
use crate::lineage::Place;

/// One value of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell<'a> {
    /// Empty or null.
    Missing,
    /// A number.
    Number(f64),
    /// Text; a number where one is needed and it reads as one.
    Text(&'a str),
}

/// Collects rows; an event ends where the next one begins.
pub(super) struct Rows {
    roles: Vec<Role>,
    id_column: usize,
    current: Option<Current>,
    ended: HashSet<String>,
}

struct Current {
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
        Self { roles, id_column, current: None, ended: HashSet::new() }
    }

    /// Takes row `number`, one cell a column.
    pub(super) fn row(
        &mut self,
        number: u64,
        cells: &[Cell<'_>],
        output: &mut Output<'_, '_>,
    ) -> Result<(), FormatError> {
        let id = match cells[self.id_column] {
            Cell::Missing => Cow::from(""),
            Cell::Text(text) => Cow::from(text),
            Cell::Number(id) => Cow::from(id.to_string()),
        };
        if self.current.as_ref().is_none_or(|current| current.id != id) {
            self.flush(output)?;
            if self.ended.contains(id.as_ref()) {
                let detail = format!("rows of event {:?} are not together", shortened(&id));
                return Err(FormatError::invalid(Place::Row(number), "rows_apart", detail));
            }
            let mut draft = Draft::default();
            draft.set_text("event_id", &id, output.limits.max_text_bytes);
            let id = id.into_owned();
            self.current = Some(Current { id, draft, first_row: number, steps: 0, texts: [const { None }; 3] });
        }
        let current = self.current.as_mut().expect("an event was just begun");
        current.step(&self.roles, cells, output);
        Ok(())
    }

    /// The row has other cells than the header: whatever event it is of is refused.
    pub(super) fn ragged(&mut self, found: usize) {
        let wanted = self.roles.len();
        if let Some(current) = &mut self.current {
            let step = current.steps.saturating_sub(1);
            current
                .draft
                .flaw(None, step, "wrong_cell_count", || format!("the row has {found} cells, the header {wanted}"));
        }
    }

    /// Hands over the event whose rows have ended.
    pub(super) fn flush(&mut self, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        let Some(current) = self.current.take() else { return Ok(()) };
        output.put(current.draft, Origin::Row(current.first_row))?;
        if !current.id.is_empty() {
            self.ended.insert(current.id);
        }
        Ok(())
    }
}

impl Current {
    fn step(&mut self, roles: &[Role], cells: &[Cell<'_>], output: &Output<'_, '_>) {
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

    /// A column that says the same in every row of an event.
    fn text(&mut self, slot: usize, role: Role, cell: Cell<'_>, step: usize, max_bytes: u32) {
        let text = match cell {
            Cell::Missing => Cow::from(""),
            Cell::Text(text) => Cow::from(text),
            Cell::Number(number) => Cow::from(number.to_string()),
        };
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
        let recording = &mut self.draft.recording;
        match role {
            Role::Spacing => recording.spacing_m.push(value),
            Role::FollowerSpeed => recording.follower_speed_mps.push(value),
            Role::LeaderSpeed => recording.leader_speed_mps.push(value),
            Role::RelSpeed => recording.rel_speed_mps.get_or_insert_default().push(value),
            Role::Time => recording.t_s.get_or_insert_default().push(value),
            _ => match recording.dt_s {
                None => recording.dt_s = Some(value),
                Some(first) if first.to_bits() == value.to_bits() => {}
                Some(first) => differs(&mut self.draft, role, step, &value.to_string(), &first.to_string()),
            },
        }
    }
}

fn flawed(draft: &mut Draft, role: Role, step: usize, code: &'static str, what: &str) {
    let field = role.field();
    draft.flaw(Cow::from(field), step, code, || format!("{field} at step {step} {what}"));
}

fn differs(draft: &mut Draft, role: Role, step: usize, value: &str, first: &str) {
    flawed(draft, role, step, "inconsistent_rows", &format!("is {value:?}, and {first:?} in the event's first row"));
}
