//! A decoded event, and where it was.

use std::borrow::Cow;

use crate::car_following::{Defect, Recording};
use crate::lineage::{Place, Rejection, Split};

/// An event as it was sent; nothing about its numbers is known yet.
#[derive(Debug, Clone, PartialEq)]
pub struct RawEvent {
    /// Index in the body, from 0.
    pub index: u64,
    /// The client's id.
    pub event_id: String,
    /// Where it was recorded.
    pub source: Option<String>,
    /// Of which recording it is a part.
    pub run: Option<String>,
    /// The split it names itself.
    pub split: Option<Split>,
    /// Its numbers.
    pub recording: Recording,
    /// Where it was.
    pub origin: Origin,
}

impl RawEvent {
    /// Its rejection for `defects`, of which there is at least one.
    #[must_use]
    pub fn reject(&self, defects: Vec<Defect>) -> Rejection {
        let flaws: Vec<_> = defects.into_iter().map(Flaw::from).collect();
        reject(self.index, Some(self.event_id.clone()), self.origin, &flaws)
    }
}

/// Where an event was in its body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// This element of `events` in a JSON document.
    Element(u64),
    /// This line, from 1.
    Line(u64),
    /// From this data row on, from 1; one row a step.
    Row(u64),
    /// From this row of a whole road on, from 1; rows of other vehicles lie between its steps.
    Among(u64),
    /// This event of an array.
    Entry(u64),
}

/// Columns of an event in an array, in their order.
const ARRAY: [&str; 4] = ["spacing_m", "follower_speed_mps", "rel_speed_mps", "leader_speed_mps"];

impl Origin {
    /// Where a field of the event, or one step of it, was.
    #[must_use]
    pub fn place(self, field: Option<&str>, step: Option<usize>) -> Place {
        match self {
            Self::Line(line) => Place::Line(line),
            Self::Row(first) => Place::Row(first + step.unwrap_or(0) as u64),
            Self::Among(first) => Place::Row(first),
            Self::Entry(index) => {
                let column = field.and_then(|field| ARRAY.iter().position(|known| *known == field));
                Place::Pointer(match (column, step) {
                    (None, _) => format!("/{index}"),
                    (Some(column), None) => format!("/{index}/{column}"),
                    (Some(column), Some(step)) => format!("/{index}/{column}/{step}"),
                })
            }
            Self::Element(index) => {
                let field = field.map(|field| field.replace('~', "~0").replace('/', "~1"));
                Place::Pointer(match (field, step) {
                    (None, _) => format!("/events/{index}"),
                    (Some(field), None) => format!("/events/{index}/{field}"),
                    (Some(field), Some(step)) => format!("/events/{index}/{field}/{step}"),
                })
            }
        }
    }
}

/// Why an event was refused, by the name of its field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Flaw {
    pub(super) field: Option<Cow<'static, str>>,
    pub(super) step: Option<usize>,
    pub(super) code: &'static str,
    pub(super) detail: String,
}

impl From<Defect> for Flaw {
    fn from(defect: Defect) -> Self {
        Self { field: defect.field.map(Cow::from), step: defect.step, code: defect.code, detail: defect.detail }
    }
}

/// One rejection for an event: place and code of its first flaw, the details of all.
pub(super) fn reject(index: u64, event_id: Option<String>, origin: Origin, flaws: &[Flaw]) -> Rejection {
    let first = flaws.first().expect("a rejection has a reason");
    let details: Vec<_> = flaws.iter().map(|flaw| flaw.detail.as_str()).collect();
    Rejection {
        index,
        event_id,
        place: origin.place(first.field.as_deref(), first.step),
        code: first.code.to_owned(),
        detail: details.join("; also, "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_point_at_the_step() {
        let place = |origin: Origin| origin.place(Some("a/b~c"), Some(17)).to_string();
        assert_eq!(place(Origin::Element(3)), "/events/3/a~1b~0c/17");
        assert_eq!(place(Origin::Line(4)), "4");
        assert_eq!(place(Origin::Row(100)), "117");
        assert_eq!(Origin::Entry(2).place(Some("rel_speed_mps"), Some(9)).to_string(), "/2/2/9");
        assert_eq!(Origin::Entry(2).place(Some("event_id"), None).to_string(), "/2");
        assert_eq!(Origin::Element(0).place(None, None).to_string(), "/events/0");
    }
}
