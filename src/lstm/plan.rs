//! Which windows are alive at which step, and where their rows lie.

use std::ops::Range;

/// Row bookkeeping for the overlapping windows of several events.
///
/// A window that starts at step `s` reads the steps `s … s + horizon − 1` and answers at the last of them. At step `t` the
/// `horizon` windows that started at `t, t − 1, …` advance together: slot 0 is the one that just started, the last slot the
/// one that answers. Events are sorted by length, longest first, so that the events a window exists for are always a prefix.
///
/// Rows of all slots but the first, at step `t`, lie at [`Plan::carried`]`(t)`: slot 1 first, the answering slot last. What
/// step `t` leaves behind for step `t + 1` therefore lies in the same order, [`Plan::first`] rows of slot 0, then the others
/// without the answering ones, so that nothing is ever moved.
#[derive(Debug, Default)]
pub(super) struct Plan {
    horizon: usize,
    /// Windows starting at each step: the number of events that are long enough.
    starting: Vec<usize>,
    /// Prefix sums of `starting`.
    first_row: Vec<usize>,
    /// Prefix sums of the carried rows of each step.
    carried_row: Vec<usize>,
}

impl Plan {
    /// A plan for events of these many input steps each, longest first.
    pub(super) fn set(&mut self, horizon: usize, input_steps: &[usize]) {
        assert!(horizon >= 2 && input_steps.is_sorted_by(|a, b| a >= b));
        self.horizon = horizon;
        let steps = input_steps.first().copied().unwrap_or(0);
        self.starting.clear();
        self.first_row.clear();
        self.carried_row.clear();
        let (mut first, mut carried, mut carried_rows) = (0, 0, 0);
        for t in 0..steps {
            let starting = input_steps.iter().take_while(|&&n| t + horizon <= n).count();
            self.first_row.push(first);
            self.carried_row.push(carried);
            self.starting.push(starting);
            first += starting;
            carried += carried_rows;
            carried_rows += starting;
            carried_rows -= self.answering(t).len();
        }
        self.first_row.push(first);
        self.carried_row.push(carried);
    }

    /// Input steps of the longest event.
    pub(super) fn steps(&self) -> usize {
        self.starting.len()
    }

    /// Windows in all.
    pub(super) fn windows(&self) -> usize {
        self.first_row[self.steps()]
    }

    /// Carried rows in all.
    pub(super) fn all_carried(&self) -> usize {
        self.carried_row[self.steps()]
    }

    /// Events that some window at step `t` reads.
    pub(super) fn events(&self, t: usize) -> usize {
        self.starting[(t + 1).saturating_sub(self.horizon)]
    }

    /// Rows of slot 0 at step `t`, among the windows in order of their start.
    pub(super) fn first(&self, t: usize) -> Range<usize> {
        self.first_row[t]..self.first_row[t + 1]
    }

    /// Rows of the windows that answer at step `t`, in the same numbering as [`Self::first`].
    pub(super) fn answering(&self, t: usize) -> Range<usize> {
        match (t + 1).checked_sub(self.horizon) {
            Some(start) => self.first_row[start]..self.first_row[start] + self.starting[start],
            None => 0..0,
        }
    }

    /// Rows of the slots after the first at step `t`.
    pub(super) fn carried(&self, t: usize) -> Range<usize> {
        self.carried_row[t]..self.carried_row[t + 1]
    }

    /// The slots after the first at step `t`: rows relative to [`Self::carried`], youngest window first.
    pub(super) fn slots(&self, t: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        let mut at = 0;
        (1..self.horizon.min(t + 1)).map(move |slot| {
            let rows = at..at + self.starting[t - slot];
            at = rows.end;
            rows
        })
    }
}
