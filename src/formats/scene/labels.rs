//! What a row says of where it belongs: each such saying is kept once, and has a number.

use std::borrow::Cow;
use std::collections::HashMap;

use super::flaw;
use super::room::Room;
use crate::formats::FormatError;
use crate::formats::cell::{Cell, text_of};
use crate::formats::columns::Role;

/// Columns of text, in the order in which labels hold them.
const TEXTS: [Role; 4] = [Role::Location, Role::Source, Role::Run, Role::Split];

/// Location, source, run and split; empty where a row does not say.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(super) struct Label([String; 4]);

impl Label {
    /// Where it was recorded.
    pub(super) fn source(&self) -> &str {
        let [location, source, ..] = &self.0;
        if source.is_empty() { location } else { source }
    }

    pub(super) fn run(&self) -> &str {
        &self.0[2]
    }

    pub(super) fn split(&self) -> &str {
        &self.0[3]
    }
}

/// All labels of a body, by number.
#[derive(Debug)]
pub(super) struct Labels {
    /// Which columns are there, by their places.
    columns: Vec<(usize, usize)>,
    known: Vec<Label>,
    /// Of each label, the road that it is of: vehicles of different roads have nothing to do with each other.
    roads: Vec<u32>,
    numbers: HashMap<Label, u32>,
    road_numbers: HashMap<[String; 2], u32>,
    last: u32,
}

impl Labels {
    /// Number 0 is the label that says nothing.
    pub(super) fn new(roles: &[Role]) -> Self {
        let place = |(text, role): (usize, &Role)| Some((text, roles.iter().position(|known| known == role)?));
        Self {
            columns: TEXTS.iter().enumerate().filter_map(place).collect(),
            known: vec![Label::default()],
            roads: vec![0],
            numbers: HashMap::from([(Label::default(), 0)]),
            road_numbers: HashMap::from([(Default::default(), 0)]),
            last: 0,
        }
    }

    /// The label of row `row`.
    pub(super) fn of(
        &mut self,
        cells: &[Cell<'_>],
        row: u64,
        max_text_bytes: u32,
        room: &mut Room,
    ) -> Result<u32, FormatError> {
        let mut texts = [const { Cow::Borrowed("") }; 4];
        for &(text, column) in &self.columns {
            texts[text] = text_of(cells[column]);
        }
        // Rows come in long stretches that say the same.
        if self.known[self.last as usize].0 == texts {
            return Ok(self.last);
        }
        if let Some(long) = texts.iter().find(|text| text.len() > max_text_bytes as usize) {
            let detail = format!("a text in row {row} has {} bytes, at most {max_text_bytes} are kept", long.len());
            return Err(flaw(row, "text_too_long", detail));
        }
        let label = Label(texts.map(Cow::into_owned));
        self.last = match self.numbers.get(&label) {
            Some(&number) => number,
            None => self.add(label, room)?,
        };
        Ok(self.last)
    }

    fn add(&mut self, label: Label, room: &mut Room) -> Result<u32, FormatError> {
        for text in &label.0 {
            // Once in the list, once in the index, and once more for the road.
            room.take_text(text)?;
            room.take_text(text)?;
            room.take_text(text)?;
        }
        let number = u32::try_from(self.known.len()).expect("room is counted in 32 bits");
        let roads = self.road_numbers.len() as u32;
        let [location, source, ..] = &label.0;
        let road = *self.road_numbers.entry([location.clone(), source.clone()]).or_insert(roads);
        self.roads.push(road);
        self.known.push(label.clone());
        self.numbers.insert(label, number);
        Ok(number)
    }

    pub(super) fn road(&self, label: u32) -> u32 {
        self.roads[label as usize]
    }

    pub(super) fn get(&self, label: u32) -> &Label {
        &self.known[label as usize]
    }
}
