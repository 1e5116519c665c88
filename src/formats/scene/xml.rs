//! Floating-car data as XML: `fcd-export` of `timestep` of `vehicle`, element by element; whatever else there is is passed over.
//!
//! There is no document type, and no entity but the five that XML has by itself, so that nothing expands and nothing is
//! fetched.

use std::io::BufRead;

use quick_xml::Reader;
use quick_xml::XmlVersion;
use quick_xml::errors::{Error, SyntaxError};
use quick_xml::events::{BytesStart, Event};

use super::fcd::{Fcd, Vehicle};
use super::{needed, number};
use crate::car_following::{Extraction, ExtractionSettings};
use crate::formats::FormatError;
use crate::formats::cell::Cell;
use crate::formats::columns::Role;
use crate::formats::output::Output;
use crate::formats::source::Budget;

/// Elements within each other, attributes of one, and bytes of its tag: SUMO writes 3, about 20, and some hundred.
const MAX_DEPTH: usize = 16;
const MAX_ATTRIBUTES: usize = 64;
const MAX_TAG_BYTES: usize = 16 << 10;

/// Decodes an element at a time.
pub(in crate::formats) fn decode(
    reader: Box<dyn BufRead>,
    budget: &Budget,
    settings: &ExtractionSettings,
    output: &mut Output<'_, '_>,
) -> Result<Extraction, FormatError> {
    let mut reader = Reader::from_reader(reader);
    let mut buffer = Vec::new();
    let fcd = Fcd::of_document(output.limits, settings);
    let mut document = Document { fcd, depth: 0, in_timestep: false, over: false, row: 0 };
    loop {
        budget.next_event();
        buffer.clear();
        match reader.read_event_into(&mut buffer).map_err(broken)? {
            Event::Eof => break,
            event => document.take(&event, output)?,
        }
    }
    if !document.over {
        return Err(FormatError::Truncated { detail: "an element is not closed, or there is none".to_owned() });
    }
    document.fcd.close(output)
}

/// Where in the document reading is.
struct Document {
    fcd: Fcd,
    /// Elements that are open.
    depth: usize,
    in_timestep: bool,
    /// Whether the outermost element is closed.
    over: bool,
    /// Vehicles so far.
    row: u64,
}

impl Document {
    fn take(&mut self, event: &Event<'_>, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        match event {
            Event::Start(element) => {
                self.open(element, output)?;
                self.depth += 1;
                if self.depth > MAX_DEPTH {
                    return Err(malformed(&format!("elements lie more than {MAX_DEPTH} deep")));
                }
            }
            Event::Empty(element) => {
                self.open(element, output)?;
                self.left();
            }
            Event::End(_) => {
                self.depth -= 1;
                self.left();
            }
            Event::Text(text) if text.iter().all(u8::is_ascii_whitespace) => {}
            Event::Text(_) | Event::CData(_) => return Err(malformed(&"there is text between elements")),
            Event::GeneralRef(_) => return Err(malformed(&"there is an entity between elements")),
            Event::DocType(_) => return Err(malformed(&"a document type is not read")),
            Event::Decl(declaration) => {
                let encoding = declaration.encoding().transpose().map_err(|e| malformed(&e))?;
                let known =
                    |name: &[u8]| [&b"utf-8"[..], b"us-ascii"].iter().any(|known| known.eq_ignore_ascii_case(name));
                if encoding.is_some_and(|name| !known(&name)) {
                    return Err(malformed(&"XML must be UTF-8, and says that it is not"));
                }
            }
            Event::Comment(_) | Event::PI(_) | Event::Eof => {}
        }
        Ok(())
    }

    /// An element begins at this depth.
    fn open(&mut self, element: &BytesStart<'_>, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        if self.over {
            return Err(malformed(&"there is more than one outermost element"));
        }
        if element.len() > MAX_TAG_BYTES {
            return Err(malformed(&format!("a tag has more than {MAX_TAG_BYTES} bytes")));
        }
        std::str::from_utf8(element).map_err(|_| malformed(&"XML must be UTF-8, and a tag is not"))?;
        match (self.depth, element.local_name().as_ref()) {
            (0, b"fcd-export") => unread(element)?,
            (0, _) => {
                let detail = "the outermost element is not fcd-export: of SUMO's files, floating-car data are read";
                return Err(FormatError::invalid(None, "not_fcd", detail.to_owned()));
            }
            (1, b"timestep") => {
                let [time] = attributes(element, ["time"])?;
                let row = self.row + 1;
                self.fcd.time(needed(cell(time.as_deref()), Role::Time, row)?, row, output)?;
                self.in_timestep = true;
            }
            (2, b"vehicle") if self.in_timestep => self.vehicle(element, output)?,
            // Who walks, what is carried, and what other releases write.
            _ => unread(element)?,
        }
        Ok(())
    }

    /// An element ended at this depth.
    fn left(&mut self) {
        match self.depth {
            0 => self.over = true,
            1 => self.in_timestep = false,
            _ => {}
        }
    }

    fn vehicle(&mut self, element: &BytesStart<'_>, output: &mut Output<'_, '_>) -> Result<(), FormatError> {
        self.row += 1;
        let row = self.row;
        let names = ["id", "speed", "leaderID", "leaderSpeed", "leaderGap"];
        let [id, speed, leader, leader_speed, gap] = attributes(element, names)?;
        self.fcd.says_leaders |= leader.is_some() && gap.is_some();
        let id = id.filter(|id| !id.is_empty());
        let missing = || super::flaw(row, "missing_value", format!("vehicle {row} has no id"));
        let vehicle = Vehicle {
            row,
            id: &id.ok_or_else(missing)?,
            speed_mps: needed(cell(speed.as_deref()), Role::Speed, row)?,
            leader_id: leader.as_deref().unwrap_or_default(),
            leader_speed_mps: number(cell(leader_speed.as_deref()), Role::LeaderSpeed, row)?,
            gap_m: number(cell(gap.as_deref()), Role::Gap, row)?,
            label: 0,
        };
        self.fcd.vehicle(&vehicle, output)
    }
}

/// Passes over an element that is well formed.
fn unread(element: &BytesStart<'_>) -> Result<(), FormatError> {
    attributes(element, []).map(|[]| ())
}

/// The values of the attributes of these names.
fn attributes<const N: usize>(element: &BytesStart<'_>, names: [&str; N]) -> Result<[Option<String>; N], FormatError> {
    let mut values = [const { None }; N];
    for (count, attribute) in element.attributes().enumerate() {
        if count == MAX_ATTRIBUTES {
            return Err(malformed(&format!("an element has more than {MAX_ATTRIBUTES} attributes")));
        }
        let attribute = attribute.map_err(|e| malformed(&e))?;
        let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|e| malformed(&e))?;
        if let Some(at) = names.iter().position(|name| name.as_bytes() == attribute.key.as_ref()) {
            values[at] = Some(value.trim().to_owned());
        }
    }
    Ok(values)
}

fn cell(value: Option<&str>) -> Cell<'_> {
    match value {
        None | Some("") => Cell::Missing,
        Some(text) => Cell::Text(text),
    }
}

fn malformed(detail: &impl ToString) -> FormatError {
    FormatError::malformed(None, detail)
}

/// Why the document cannot be read on.
fn broken(error: Error) -> FormatError {
    match error {
        // Nobody else has it.
        Error::Io(error) => match std::sync::Arc::try_unwrap(error) {
            Ok(error) => error.into(),
            Err(error) => malformed(&error),
        },
        Error::Syntax(SyntaxError::InvalidBangMarkup) => malformed(&error),
        // All others are something that the end of the body leaves open.
        Error::Syntax(error) => FormatError::Truncated { detail: error.to_string() },
        error => malformed(&error),
    }
}
