//! JSON: a document with `events`.

use std::fmt;
use std::io::BufRead;

use serde::de::{DeserializeSeed, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;

use super::FormatError;
use super::excerpt::{excerpt, shortened};
use super::json_event::read;
use super::output::Output;
use super::raw::Origin;
use super::source::Budget;
use crate::lineage::Place;

/// Decodes `{"events": […]}` event by event.
pub(super) fn decode(
    reader: Box<dyn BufRead>,
    budget: &Budget,
    output: &mut Output<'_, '_>,
) -> Result<(), FormatError> {
    let mut deserializer = serde_json::Deserializer::from_reader(reader);
    let mut so_far = SoFar { failure: None, pointer: "" };
    let document = Document { budget, output, so_far: &mut so_far };
    let read = deserializer.deserialize_map(document).and_then(|()| deserializer.end());
    match (so_far.failure, read) {
        (Some(failure), _) => Err(failure),
        (None, Ok(())) => Ok(()),
        (None, Err(error)) if error.is_data() => {
            Err(FormatError::invalid(Place::Pointer(so_far.pointer.to_owned()), "wrong_type", excerpt(&error)))
        }
        (None, Err(error)) if error.is_eof() => Err(FormatError::Truncated { detail: error.to_string() }),
        (None, Err(error)) if error.is_io() => Err(std::io::Error::from(error).into()),
        (None, Err(error)) => Err(FormatError::malformed(None, &error)),
    }
}

/// What serde's errors do not carry, since they are text only.
struct SoFar {
    /// Our own error, behind the one that stopped serde.
    failure: Option<FormatError>,
    /// What is being read.
    pointer: &'static str,
}

/// The document.
struct Document<'a, 'o, 's> {
    budget: &'a Budget,
    output: &'a mut Output<'o, 's>,
    so_far: &'a mut SoFar,
}

impl<'de> Visitor<'de> for Document<'_, '_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object with \"events\"")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Self { budget, output, so_far } = self;
        let mut seen = false;
        while let Some(key) = map.next_key::<String>()? {
            let invalid = match key.as_str() {
                "events" if !seen => {
                    seen = true;
                    so_far.pointer = "/events";
                    map.next_value_seed(Events { budget, output, failure: &mut so_far.failure })?;
                    continue;
                }
                "events" => "duplicate_field",
                _ => "unknown_field",
            };
            let key = shortened(&key);
            let place = Place::Pointer(format!("/{}", key.replace('~', "~0").replace('/', "~1")));
            let detail = format!("{key:?}: the document holds \"events\", once, and nothing else");
            so_far.failure = Some(FormatError::invalid(place, invalid, detail));
            return Err(A::Error::custom("stopped"));
        }
        if !seen {
            let detail = "\"events\" is missing".to_owned();
            so_far.failure = Some(FormatError::invalid(Place::Pointer(String::new()), "missing_field", detail));
            return Err(A::Error::custom("stopped"));
        }
        Ok(())
    }
}

struct Events<'a, 'o, 's> {
    budget: &'a Budget,
    output: &'a mut Output<'o, 's>,
    failure: &'a mut Option<FormatError>,
}

impl<'de> DeserializeSeed<'de> for Events<'_, '_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Events<'_, '_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an array of events")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let Self { budget, output, failure } = self;
        loop {
            budget.next_event();
            // As text first: what cannot be read in it is wrong with the event, not with the document.
            let Some(text) = seq.next_element::<Box<RawValue>>()? else { return Ok(()) };
            let (draft, _) = read(text.get().as_bytes(), output.limits, "malformed_event");
            let origin = Origin::Element(output.next());
            if let Err(error) = output.put(draft, origin) {
                *failure = Some(error);
                return Err(A::Error::custom("stopped"));
            }
        }
    }
}
