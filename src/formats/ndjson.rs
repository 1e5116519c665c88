//! NDJSON: one event a line. A malformed line is refused and the next one read.

use std::io::BufRead;

use serde::de::DeserializeSeed;

use super::FormatError;
use super::draft::Draft;
use super::json_event::EventSeed;
use super::output::Output;
use super::raw::Origin;
use super::source::Budget;

/// Decodes line by line; blank lines are skipped.
pub(super) fn decode(
    mut reader: Box<dyn BufRead>,
    budget: &Budget,
    output: &mut Output<'_, '_>,
) -> Result<(), FormatError> {
    let mut line = Vec::new();
    for number in 1.. {
        budget.next_event();
        line.clear();
        if reader.read_until(b'\n', &mut line)? == 0 {
            break;
        }
        if line.trim_ascii().is_empty() {
            continue;
        }
        let mut draft = Draft::default();
        let mut deserializer = serde_json::Deserializer::from_slice(&line);
        let read = EventSeed { draft: &mut draft, limits: output.limits }
            .deserialize(&mut deserializer)
            .and_then(|()| deserializer.end());
        if let Err(error) = read {
            if error.is_eof() && line.last() != Some(&b'\n') {
                return Err(FormatError::Truncated { detail: format!("line {number} ends within an event") });
            }
            // What was read of it may be wrong in ways that follow from this.
            let mut refused = Draft::default();
            refused.event_id = draft.event_id;
            draft = refused;
            draft.flaw(None, None, "malformed_line", || format!("column {}: {error}", error.column()));
        }
        output.put(draft, Origin::Line(number))?;
    }
    Ok(())
}
