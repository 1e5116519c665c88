//! NDJSON: one event a line. A malformed line is refused and the next one read.

use std::io::BufRead;

use super::FormatError;
use super::json_event::read;
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
        let (draft, error) = read(&line, output.limits, "malformed_line");
        if error.is_some_and(|error| error.is_eof()) && line.last() != Some(&b'\n') {
            return Err(FormatError::Truncated { detail: format!("line {number} ends within an event") });
        }
        output.put(draft, Origin::Line(number))?;
    }
    Ok(())
}
