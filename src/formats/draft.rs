//! An event while it is being read.

use std::borrow::Cow;

use super::excerpt::shortened;
use super::raw::{Flaw, Origin, RawEvent, reject};
use crate::car_following::Recording;
use crate::lineage::{Rejection, Split};

/// Most flaws named of one event.
const MAX_FLAWS: usize = 4;

/// What has been read of an event, and what was wrong with it.
#[derive(Debug, Default)]
pub(super) struct Draft {
    pub(super) event_id: Option<String>,
    pub(super) source: Option<String>,
    pub(super) run: Option<String>,
    pub(super) split: Option<Split>,
    pub(super) recording: Recording,
    /// The field, and the step of it, that is being read.
    pub(super) reading: (Option<&'static str>, Option<usize>),
    flaws: Vec<Flaw>,
}

impl Draft {
    /// Notes a flaw: the first of its kind in a field, and not more than a few in all.
    pub(super) fn flaw(
        &mut self,
        field: impl Into<Option<Cow<'static, str>>>,
        step: impl Into<Option<usize>>,
        code: &'static str,
        detail: impl FnOnce() -> String,
    ) {
        let field = field.into();
        let known = self.flaws.iter().any(|flaw| flaw.code == code && flaw.field == field);
        if !known && self.flaws.len() < MAX_FLAWS {
            self.flaws.push(Flaw { field, step: step.into(), code, detail: detail() });
        }
    }

    /// Sets `event_id`, `source`, `run` or `split` from text; empty is absent.
    pub(super) fn set_text(&mut self, field: &'static str, text: &str, max_bytes: u32) {
        if text.is_empty() {
            return;
        }
        if text.len() > max_bytes as usize {
            let length = text.len();
            self.flaw(Cow::from(field), None, "text_too_long", || {
                format!("{field} has {length} bytes, at most {max_bytes} are kept")
            });
            return;
        }
        match field {
            "event_id" => self.event_id = Some(text.to_owned()),
            "source" => self.source = Some(text.to_owned()),
            "run" => self.run = Some(text.to_owned()),
            _ => {
                self.split = Split::parse(text);
                if self.split.is_none() {
                    self.flaw(Cow::from(field), None, "invalid_split", || {
                        format!("split {:?} is not train, validation or test", shortened(text))
                    });
                }
            }
        }
    }

    /// The event, or its rejection.
    pub(super) fn finish(mut self, index: u64, origin: Origin) -> Result<RawEvent, Rejection> {
        // Only a flawless event lacks its id for want of one.
        if self.event_id.is_none() && self.flaws.is_empty() {
            self.flaw(Cow::from("event_id"), None, "missing_field", || "event_id is missing".to_owned());
        }
        match self.event_id {
            Some(event_id) if self.flaws.is_empty() => Ok(RawEvent {
                index,
                event_id,
                source: self.source,
                run: self.run,
                split: self.split,
                recording: self.recording,
                origin,
            }),
            event_id => Err(reject(index, event_id, origin, &self.flaws)),
        }
    }
}
