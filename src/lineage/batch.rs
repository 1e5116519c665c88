//! The events of one upload, and what was refused of it.

use jiff::Timestamp;
use serde::Serialize;
use serde_json::Value;

use super::RegimeName;

/// A batch as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// Its id; `b12` on the wire.
    pub batch_id: i64,
    /// The model's row id.
    pub model_id: i64,
    /// As the upload named it.
    pub source: Option<String>,
    /// The upload's label.
    pub regime: Option<RegimeName>,
    /// Media type of the body.
    pub content_type: String,
    /// Digest of the body as it was sent, hex.
    pub body_sha256: String,
    /// Length of the body as it was sent.
    pub body_bytes: u64,
    /// Events stored, or brought back after a retraction.
    pub accepted: u64,
    /// Events whose content the model had already.
    pub duplicates: u64,
    /// Events refused.
    pub rejected: u64,
    /// What was accepted or known, JSON.
    pub summary: Value,
    /// When it was stored.
    pub created_at: Timestamp,
    /// When it was retracted.
    pub retracted_at: Option<Timestamp>,
    /// When somebody asked for the erasure of its content.
    pub erase_asked_at: Option<Timestamp>,
    /// When none of it was left.
    pub erased_at: Option<Timestamp>,
}

/// Distinct events of a batch by state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct EventCounts {
    /// Waiting, or in a queued or running task.
    pub pending: u64,
    /// In a version of the line.
    pub learned: u64,
    /// Train only when named again.
    pub set_aside: u64,
    /// Made training fail, or came from a source that is held.
    pub held: u64,
    /// Withdrawn.
    pub retracted: u64,
    /// Of all these, those whose arrays retention did not keep.
    #[serde(skip)]
    pub pruned: u64,
}

/// Where in a body something is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// A JSON pointer into the document.
    Pointer(String),
    /// A line of an NDJSON body, from 1.
    Line(u64),
    /// A data row of a CSV or Parquet body, from 1; the header is not counted. Of floating-car data in XML, a vehicle.
    Row(u64),
}

impl Place {
    /// The member that carries it on the wire.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Pointer(_) => "pointer",
            Self::Line(_) => "line",
            Self::Row(_) => "row",
        }
    }

    /// Its value on the wire: a string for a pointer, else a number.
    #[must_use]
    pub fn value(&self) -> Value {
        match self {
            Self::Pointer(pointer) => Value::from(pointer.as_str()),
            Self::Line(number) | Self::Row(number) => Value::from(*number),
        }
    }

    /// The place of this kind whose value reads `at`.
    #[must_use]
    pub fn parse(kind: &str, at: &str) -> Option<Self> {
        match kind {
            "pointer" => Some(Self::Pointer(at.to_owned())),
            "line" => at.parse().ok().map(Self::Line),
            "row" => at.parse().ok().map(Self::Row),
            _ => None,
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Pointer(pointer) => f.write_str(pointer),
            Self::Line(number) | Self::Row(number) => write!(f, "{number}"),
        }
    }
}

/// An event that was refused: one entry an event, for its first defect; `detail` names the others too.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rejection {
    /// Index of the event in the body, from 0.
    pub index: u64,
    /// The client's id, when it could be read.
    pub event_id: Option<String>,
    /// Where.
    pub place: Place,
    /// Stable name.
    pub code: String,
    /// For a person.
    pub detail: String,
}

impl Serialize for Rejection {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap;
        let mut map = serializer.serialize_map(Some(5))?;
        map.serialize_entry("index", &self.index)?;
        map.serialize_entry("event_id", &self.event_id)?;
        map.serialize_entry(self.place.kind(), &self.place.value())?;
        map.serialize_entry("code", &self.code)?;
        map.serialize_entry("detail", &self.detail)?;
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rejection_names_its_place_by_kind() {
        let rejection = Rejection {
            index: 3,
            event_id: None,
            place: Place::Row(12),
            code: "spacing_not_positive".to_owned(),
            detail: "why".to_owned(),
        };
        let json = serde_json::to_value(&rejection).unwrap();
        assert_eq!(
            json,
            serde_json::json!({"index": 3, "event_id": null, "row": 12, "code": "spacing_not_positive", "detail": "why"})
        );
    }

    #[test]
    fn places_round_trip_through_text() {
        for place in [Place::Pointer("/events/3".to_owned()), Place::Line(7), Place::Row(9)] {
            assert_eq!(Place::parse(place.kind(), &place.to_string()), Some(place));
        }
        assert_eq!(Place::parse("line", "x"), None);
    }
}
