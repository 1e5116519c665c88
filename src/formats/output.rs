//! Where decoded events go.

use std::ops::ControlFlow;

use super::draft::Draft;
use super::raw::{Origin, RawEvent};
use super::{FormatError, FormatLimits};
use crate::lineage::Rejection;

/// Takes one event or rejection after another, in the order of the body; a break stops decoding.
pub type Sink<'a> = dyn FnMut(Result<RawEvent, Rejection>) -> ControlFlow<()> + 'a;

/// Counts events on their way to the sink.
pub(super) struct Output<'a, 's> {
    pub(super) limits: &'a FormatLimits,
    sink: &'a mut Sink<'s>,
    next: u64,
}

impl<'a, 's> Output<'a, 's> {
    pub(super) fn new(limits: &'a FormatLimits, sink: &'a mut Sink<'s>) -> Self {
        Self { limits, sink, next: 0 }
    }

    /// Index of the next event.
    pub(super) fn next(&self) -> u64 {
        self.next
    }

    /// Hands over the event that `draft` became.
    pub(super) fn put(&mut self, draft: Draft, origin: Origin) -> Result<(), FormatError> {
        if self.next >= u64::from(self.limits.max_events) {
            let detail = format!("the body holds more than {} events", self.limits.max_events);
            return Err(FormatError::TooLarge { code: "too_many_events", detail });
        }
        let decoded = draft.finish(self.next, origin);
        self.next += 1;
        match (self.sink)(decoded) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(FormatError::Stopped),
        }
    }
}
