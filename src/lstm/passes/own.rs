//! The gradient of one event among those that went together.

use super::super::ends::ProjectBackward;
use super::super::lines::{GATES, LINE, Line, Lines, lines};
use super::super::outer::{OuterProducts, Segment};
use super::{Back, GATHERED, Gradients, Passes, Real};

/// What one event left behind, collected from the steps.
#[derive(Debug)]
pub(super) struct Own<T> {
    /// Rows that went on: the step, and the row among those of its [`Segment`].
    rows: Vec<(usize, usize)>,
    dz: Vec<Line<T>>,
    h: Vec<Line<T>>,
    inputs: Vec<T>,
    dz_sum: Vec<Line<T>>,
}

impl<T: Real> Own<T> {
    /// Nothing yet.
    pub(super) fn new() -> Self {
        Self { rows: Vec::new(), dz: Vec::new(), h: Vec::new(), inputs: Vec::new(), dz_sum: Vec::new() }
    }
}

impl<T: Real> Passes<T> {
    /// Adds the derivatives by all weights that event `n` alone contributes to `gradient`, once every step was gone back
    /// through.
    ///
    /// # Panics
    /// When [`Gradients::Summed`] were asked for.
    pub fn add_own(&mut self, n: usize, gradient: &mut [T]) {
        assert_eq!(self.back.wanted, Gradients::Own, "each event's own was asked for");
        self.back.gradient.clear();
        self.own_recurrent(n);
        self.own_input(n);
        self.own_head(n);
        self.back.gradient.add_to(gradient);
    }

    /// Of each step, the derivatives by its events' pre-activations and the states after it, after a way back for
    /// [`Gradients::Own`].
    pub(in crate::lstm) fn kept(&self) -> (&[Line<T>], &[Line<T>]) {
        (&self.back.dz_sum, &self.h)
    }

    /// A few rows at a time, so that what is copied is still near when it is summed.
    fn own_recurrent(&mut self, n: usize) {
        let units = lines(self.layout.hidden);
        let Back { dz, gathered, gradient, own, .. } = &mut self.back;
        own.rows.clear();
        // The way back met the last step first, and no first step, which has nothing before it.
        let later = self.plan.steps().iter().rev().filter(|step| step.later() > 0);
        for (segment, step) in later.enumerate() {
            let events = &self.plan.events(*step)[step.begun..];
            own.rows.extend(events.iter().enumerate().filter(|(_, event)| **event == n).map(|(row, _)| (segment, row)));
        }
        for rows in own.rows.chunks(GATHERED) {
            let collect =
                |from: &[Line<T>], to: &mut Vec<Line<T>>, lines: usize, place: fn(&Segment) -> (usize, usize)| {
                    to.clear();
                    for line in 0..lines {
                        to.extend(rows.iter().map(|&(segment, row)| {
                            let (start, rows) = place(&gathered[segment]);
                            from[start + line * rows + row]
                        }));
                    }
                };
            collect(dz, &mut own.dz, GATES * units, |segment| (segment.dz, segment.rows));
            collect(&self.h, &mut own.h, units, |segment| (segment.h, segment.h_rows));
            let segments = &[Segment { rows: rows.len(), dz: 0, h: 0, h_rows: rows.len() }];
            let (outputs, sums) = (GATES * units * LINE, &mut gradient.recurrent);
            T::run(OuterProducts { segments, dz: &own.dz, h: &own.h, lines: units, outputs, sums });
        }
    }

    fn own_input(&mut self, n: usize) {
        let (outputs, each) = (GATES * lines(self.layout.hidden), self.layout.inputs);
        let Back { dz_sum, gradient, own, .. } = &mut self.back;
        let reading = || self.plan.steps().iter().filter(|step| n < step.events);
        own.inputs.clear();
        for step in reading() {
            own.inputs.extend_from_slice(&self.inputs[(step.read + n) * each..][..each]);
        }
        own.dz_sum.clear();
        for output in 0..outputs {
            own.dz_sum.extend(reading().map(|step| dz_sum[step.read * outputs + output * step.events + n]));
        }
        let dz = Lines::new(&own.dz_sum, own.inputs.len() / each);
        T::run(ProjectBackward { inputs: &own.inputs, dz, sums: &mut gradient.input, outputs });
    }

    fn own_head(&mut self, n: usize) {
        let units = lines(self.layout.hidden);
        let Back { dy, gradient, .. } = &mut self.back;
        for step in self.plan.steps().iter().filter(|step| n < step.answering) {
            let (dy, row) = (dy[step.read + n], step.rows - step.answering + n);
            for (line, sums) in gradient.head.iter_mut().enumerate() {
                for (sum, h) in sums.0.iter_mut().zip(self.h[step.start * units + line * step.rows + row].0) {
                    *sum += dy * h;
                }
            }
            gradient.head_bias += dy;
        }
    }
}
