//! One JSON event, read so that a bad value rejects the event and not the body.

use std::borrow::Cow;
use std::fmt;

use serde::de::{Deserialize, DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::FormatLimits;
use super::draft::Draft;
use super::excerpt::{excerpt, shortened};

const FIELDS: [&str; 9] = [
    "event_id",
    "source",
    "run",
    "split",
    "dt_s",
    "spacing_m",
    "follower_speed_mps",
    "leader_speed_mps",
    "rel_speed_mps",
];

/// The event that `text` is. Where it is no JSON, a draft of that flaw alone, with `code`, and of the id if it was read:
/// what else was read may be wrong in ways that follow from this.
pub(super) fn read(text: &[u8], limits: &FormatLimits, code: &'static str) -> (Draft, Option<serde_json::Error>) {
    let mut draft = Draft::default();
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let read = EventSeed { draft: &mut draft, limits }.deserialize(&mut deserializer);
    let Err(error) = read.and_then(|()| deserializer.end()) else { return (draft, None) };
    let mut refused = Draft::default();
    refused.event_id = draft.event_id.take();
    match draft.reading {
        // serde_json takes a number beyond any 64-bit float for a fault of syntax.
        (Some(field), step) if error.to_string().starts_with("number out of range") => {
            let at = step.map_or_else(String::new, |step| format!(" at step {step}"));
            let detail = || format!("{field}{at} is beyond the range of 64-bit numbers");
            refused.flaw(Cow::from(field), step, "not_finite", detail);
        }
        _ => refused.flaw(None, None, code, || format!("column {}: {}", error.column(), excerpt(&error))),
    }
    (refused, Some(error))
}

/// Reads one event into a draft. Only malformed JSON is an error.
struct EventSeed<'a> {
    draft: &'a mut Draft,
    limits: &'a FormatLimits,
}

impl<'de> DeserializeSeed<'de> for EventSeed<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        let draft = self.draft;
        if let Some(found) = deserializer.deserialize_any(MapOr(EventFields { draft, limits: self.limits }))? {
            draft.flaw(None, None, "wrong_type", || format!("an event is an object, this is {found}"));
        }
        Ok(())
    }
}

struct EventFields<'a> {
    draft: &'a mut Draft,
    limits: &'a FormatLimits,
}

impl EventFields<'_> {
    fn read<'de, A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Self { draft, limits } = self;
        let mut seen = [false; FIELDS.len()];
        while let Some(key) = map.next_key::<Cow<'de, str>>()? {
            let Some(position) = FIELDS.iter().position(|field| *field == key) else {
                let key = shortened(&key);
                draft.flaw(Cow::from(key.clone()), None, "unknown_field", || {
                    format!("{key:?} is not a field of an event")
                });
                map.next_value::<IgnoredAny>()?;
                continue;
            };
            let field = FIELDS[position];
            draft.reading = (Some(field), None);
            if std::mem::replace(&mut seen[position], true) {
                draft.flaw(Cow::from(field), None, "duplicate_field", || format!("{field} is there twice"));
                map.next_value::<IgnoredAny>()?;
                continue;
            }
            match field {
                "spacing_m" | "follower_speed_mps" | "leader_speed_mps" | "rel_speed_mps" => {
                    let present = map.next_value_seed(ArraySeed { draft, limits, field })?;
                    seen[position] = present;
                }
                _ => scalar(draft, limits, field, map.next_value()?),
            }
        }
        for (field, seen) in FIELDS.into_iter().zip(seen) {
            let required = matches!(field, "event_id" | "spacing_m" | "follower_speed_mps" | "leader_speed_mps");
            if required && !seen {
                draft.flaw(None, None, "missing_field", || format!("{field} is missing"));
            }
        }
        Ok(())
    }
}

fn scalar(draft: &mut Draft, limits: &FormatLimits, field: &'static str, leaf: Leaf<'_>) {
    match (field, leaf) {
        (_, Leaf::Null) => {}
        ("dt_s", Leaf::Number(dt_s)) => draft.recording.dt_s = Some(dt_s),
        ("dt_s", Leaf::Whole(dt_s)) => draft.recording.dt_s = Some(dt_s as f64),
        ("event_id", Leaf::Whole(id)) => draft.event_id = Some(id.to_string()),
        ("event_id" | "source" | "run" | "split", Leaf::Text(text)) => {
            draft.set_text(field, &text, limits.max_text_bytes);
        }
        (_, leaf) => {
            let wanted = if field == "dt_s" { "a number" } else { "a string" };
            let found = leaf.kind();
            draft.flaw(Cow::from(field), None, "wrong_type", || format!("{field} must be {wanted}, not {found}"));
        }
    }
}

/// Reads one array into the draft; false for null.
struct ArraySeed<'a> {
    draft: &'a mut Draft,
    limits: &'a FormatLimits,
    field: &'static str,
}

impl<'de> DeserializeSeed<'de> for ArraySeed<'_> {
    type Value = bool;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<bool, D::Error> {
        let Self { draft, limits, field } = self;
        let found = deserializer.deserialize_any(SeqOr(Numbers { draft, limits, field }))?;
        if let Some(found) = found.filter(|&found| found != "null") {
            draft.flaw(Cow::from(field), None, "wrong_type", || format!("{field} must be an array, not {found}"));
        }
        Ok(found != Some("null"))
    }
}

struct Numbers<'a> {
    draft: &'a mut Draft,
    limits: &'a FormatLimits,
    field: &'static str,
}

impl Numbers<'_> {
    fn read<'de, A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let Self { draft, limits, field } = self;
        let max_steps = limits.max_steps as usize;
        let mut values = Vec::new();
        loop {
            let step = values.len();
            draft.reading = (Some(field), Some(step));
            let Some(leaf) = seq.next_element::<Leaf<'de>>()? else { break };
            if step == max_steps {
                draft.flaw(Cow::from(field), step, "too_many_steps", || {
                    format!("{field} has more than {max_steps} steps")
                });
                while seq.next_element::<IgnoredAny>()?.is_some() {}
                break;
            }
            values.push(match leaf {
                Leaf::Number(value) => value,
                Leaf::Whole(value) => value as f64,
                other => {
                    let found = other.kind();
                    draft.flaw(Cow::from(field), step, "wrong_type", || {
                        format!("{field} at step {step} is {found}, not a number")
                    });
                    0.0
                }
            });
        }
        let recording = &mut draft.recording;
        match field {
            "spacing_m" => recording.spacing_m = values,
            "follower_speed_mps" => recording.follower_speed_mps = values,
            "leader_speed_mps" => recording.leader_speed_mps = values,
            _ => recording.rel_speed_mps = Some(values),
        }
        Ok(())
    }
}

/// A value without members, or the name of what it is instead.
enum Leaf<'de> {
    Null,
    Number(f64),
    Whole(i128),
    Text(Cow<'de, str>),
    Other(&'static str),
}

impl Leaf<'_> {
    fn kind(&self) -> &'static str {
        match self {
            Self::Null => "null",
            Self::Number(_) | Self::Whole(_) => "a number",
            Self::Text(_) => "a string",
            Self::Other(kind) => kind,
        }
    }
}

impl<'de> Deserialize<'de> for Leaf<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(LeafVisitor)
    }
}

struct LeafVisitor;

impl<'de> Visitor<'de> for LeafVisitor {
    type Value = Leaf<'de>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }
    fn visit_unit<E>(self) -> Result<Leaf<'de>, E> {
        Ok(Leaf::Null)
    }
    fn visit_bool<E>(self, _: bool) -> Result<Leaf<'de>, E> {
        Ok(Leaf::Other("a boolean"))
    }
    fn visit_i64<E>(self, value: i64) -> Result<Leaf<'de>, E> {
        Ok(Leaf::Whole(value.into()))
    }
    fn visit_u64<E>(self, value: u64) -> Result<Leaf<'de>, E> {
        Ok(Leaf::Whole(value.into()))
    }
    fn visit_f64<E>(self, value: f64) -> Result<Leaf<'de>, E> {
        Ok(Leaf::Number(value))
    }
    fn visit_str<E>(self, text: &str) -> Result<Leaf<'de>, E> {
        Ok(Leaf::Text(Cow::Owned(text.to_owned())))
    }
    fn visit_borrowed_str<E>(self, text: &'de str) -> Result<Leaf<'de>, E> {
        Ok(Leaf::Text(Cow::Borrowed(text)))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Leaf<'de>, A::Error> {
        while seq.next_element::<IgnoredAny>()?.is_some() {}
        Ok(Leaf::Other("an array"))
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Leaf<'de>, A::Error> {
        while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(Leaf::Other("an object"))
    }
}

/// Implements a visitor that reads one kind of value and names any other instead of failing.
macro_rules! or_kind {
    ($type:ident, $inner:ident, $visit:ident, $access:ident, $($other:tt)*) => {
        struct $type<'a>($inner<'a>);

        impl<'de> Visitor<'de> for $type<'_> {
            type Value = Option<&'static str>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a value")
            }
            fn $visit<A: $access<'de>>(self, access: A) -> Result<Self::Value, A::Error> {
                self.0.read(access).map(|()| None)
            }
            fn visit_unit<E>(self) -> Result<Self::Value, E> {
                Ok(Some("null"))
            }
            fn visit_bool<E>(self, _: bool) -> Result<Self::Value, E> {
                Ok(Some("a boolean"))
            }
            fn visit_i64<E>(self, _: i64) -> Result<Self::Value, E> {
                Ok(Some("a number"))
            }
            fn visit_u64<E>(self, _: u64) -> Result<Self::Value, E> {
                Ok(Some("a number"))
            }
            fn visit_f64<E>(self, _: f64) -> Result<Self::Value, E> {
                Ok(Some("a number"))
            }
            fn visit_str<E>(self, _: &str) -> Result<Self::Value, E> {
                Ok(Some("a string"))
            }
            $($other)*
        }
    };
}

or_kind!(
    MapOr,
    EventFields,
    visit_map,
    MapAccess,
    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Self::Value, A::Error> {
        LeafVisitor.visit_seq(seq).map(|leaf| Some(leaf.kind()))
    }
);
or_kind!(
    SeqOr,
    Numbers,
    visit_seq,
    SeqAccess,
    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        LeafVisitor.visit_map(map).map(|leaf| Some(leaf.kind()))
    }
);
