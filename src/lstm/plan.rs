//! Which rows there are at which step, and where they lie.

/// Row bookkeeping for several events that are driven together, longest first, so that those which read or answer at a step
/// are always a prefix.
///
/// A row is a state that advances: an event's window, or an event's one carried state. At every step the rows that begin come
/// first; behind them are, in the same order, the first of the rows that the step before left behind. Nothing is ever moved:
/// row `r ≥ begun` goes on from row `r − begun` of the step before.
#[derive(Debug, Default)]
pub(super) struct Plan {
    steps: Vec<Step>,
    /// The event of each row, all steps after each other.
    events: Vec<usize>,
}

/// The rows of one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Where they begin, among the rows of all steps.
    pub(super) start: usize,
    /// Rows in all.
    pub(super) rows: usize,
    /// Those that begin: the first.
    pub(super) begun: usize,
    /// Those that answer: the last.
    pub(super) answering: usize,
    /// Events that they read.
    pub(super) events: usize,
    /// Those that earlier steps read, added up.
    pub(super) read: usize,
}

impl Step {
    /// Rows that go on from the step before.
    pub(super) fn later(self) -> usize {
        self.rows - self.begun
    }
}

impl Plan {
    /// Every window of `horizon` steps of events of these many input steps each. A window begins at each step, reads `horizon`
    /// steps and answers at the last of them: those that began last come first, and those that answer are the last.
    pub(super) fn windows(&mut self, horizon: usize, input_steps: &[usize]) {
        assert!(horizon >= 1, "a window has steps");
        let beginning = |t: usize| alive(input_steps, t + horizon - 1);
        self.set(input_steps, |t, events| {
            for start in (t.saturating_sub(horizon - 1)..=t).rev() {
                events.extend(0..beginning(start));
            }
            (beginning(t), (t + 1).checked_sub(horizon).map_or(0, beginning))
        });
    }

    /// One state along each event, which answers at every step from `horizon` − 1 on.
    pub(super) fn carried(&mut self, horizon: usize, input_steps: &[usize]) {
        assert!(horizon >= 1, "an answer follows some steps");
        self.set(input_steps, |t, events| {
            let alive = alive(input_steps, t);
            events.extend(0..alive);
            (if t == 0 { alive } else { 0 }, if t + 1 >= horizon { alive } else { 0 })
        });
    }

    /// `rows` adds the event of each row of a step, and says how many begin and how many answer.
    fn set(&mut self, input_steps: &[usize], rows: impl Fn(usize, &mut Vec<usize>) -> (usize, usize)) {
        assert!(input_steps.is_sorted_by(|a, b| a >= b), "events come longest first");
        self.steps.clear();
        self.events.clear();
        for t in 0..input_steps.first().copied().unwrap_or(0) {
            let start = self.events.len();
            let (begun, answering) = rows(t, &mut self.events);
            let events = self.events[start..].iter().max().map_or(0, |last| last + 1);
            let read = self.steps.last().map_or(0, |last| last.read + last.events);
            self.steps.push(Step { start, rows: self.events.len() - start, begun, answering, events, read });
        }
    }

    /// Every step.
    pub(super) fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// The step before `t`.
    pub(super) fn before(&self, t: usize) -> Option<Step> {
        t.checked_sub(1).map(|before| self.steps[before])
    }

    /// Rows of all steps.
    pub(super) fn rows(&self) -> usize {
        self.events.len()
    }

    /// Events that steps read, all steps added up.
    pub(super) fn read(&self) -> usize {
        self.steps.last().map_or(0, |last| last.read + last.events)
    }

    /// The event of each row of a step.
    pub(super) fn events(&self, step: Step) -> &[usize] {
        &self.events[step.start..][..step.rows]
    }
}

/// Events that have a step `t`.
fn alive(input_steps: &[usize], t: usize) -> usize {
    input_steps.iter().take_while(|&&steps| t < steps).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// (begun, later, answering, events) of each step.
    fn counts(plan: &Plan) -> Vec<(usize, usize, usize, usize)> {
        plan.steps().iter().map(|step| (step.begun, step.later(), step.answering, step.events)).collect()
    }

    #[test]
    fn windows_begin_while_they_can_still_answer() {
        let mut plan = Plan::default();
        plan.windows(3, &[5, 4, 3]);
        assert_eq!(counts(&plan), [(3, 0, 0, 3), (2, 3, 0, 3), (1, 5, 3, 3), (0, 3, 2, 2), (0, 1, 1, 1)]);
        assert_eq!(plan.events(plan.steps()[2]), [0, 0, 1, 0, 1, 2]);
        assert_eq!(plan.rows(), 3 + 5 + 6 + 3 + 1);
    }

    #[test]
    fn a_carried_state_lives_as_long_as_its_event() {
        let mut plan = Plan::default();
        plan.carried(2, &[3, 1]);
        assert_eq!(counts(&plan), [(2, 0, 0, 2), (0, 1, 1, 1), (0, 1, 1, 1)]);
    }

    #[test]
    fn rows_go_on_for_the_event_they_began_for() {
        for horizon in 1..5 {
            let mut plan = Plan::default();
            for set in [Plan::windows, Plan::carried] {
                set(&mut plan, horizon, &[9, 9, 6, 5]);
                for steps in plan.steps().windows(2) {
                    let (before, now) = (plan.events(steps[0]), plan.events(steps[1]));
                    assert_eq!(now[steps[1].begun..], before[..steps[1].later()]);
                }
            }
        }
    }
}
