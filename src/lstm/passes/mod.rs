//! Forward and backward through the steps of some events, all rows of a step together.

mod own;

use std::ops::Range;

use super::backward::{ThroughGates, ThroughWeights};
use super::ends::{Dots, HeadBackward, ProjectBackward};
use super::forward::Forward;
use super::gradient::Gradient;
use super::lines::{GATES, LINE, Line, Lines, grow, lines};
use super::outer::{OuterProducts, Segment};
use super::plan::{Plan, Step};
use super::{Layout, Network, Real};
use own::Own;

/// Rows of work whose outer products are added up at once, at least.
const GATHERED: usize = 64;

/// How a network goes through events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rows {
    /// Every window from a zero state. Those that overlap advance together.
    Windows,
    /// One state along each event.
    Carried,
}

/// What the way back is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gradients {
    /// The sum of all events' gradients, which [`Passes::finish`] hands over.
    Summed,
    /// Each event's own, which [`Passes::add_own`] computes.
    Own,
}

/// Activations of every step of some events, and the passes over them. Buffers are kept for the next set of events.
///
/// Use: [`Passes::begin`], then [`Passes::forward`] for each step in order; then, any number of times, [`Passes::turn`],
/// [`Passes::backward`] for each step in reverse, and [`Passes::finish`] or [`Passes::add_own`].
#[derive(Debug)]
pub struct Passes<T> {
    layout: Layout,
    kind: Rows,
    plan: Plan,
    /// Of each step, event by event.
    inputs: Vec<T>,
    /// Of each step, its lines of rows: gates, and states after it.
    z: Vec<Line<T>>,
    c: Vec<Line<T>>,
    h: Vec<Line<T>>,
    projected: Vec<Line<T>>,
    outputs: Vec<T>,
    back: Back<T>,
}

/// Derivatives on the way back.
#[derive(Debug)]
struct Back<T> {
    /// By the states after the step, and by those before it.
    dh: Vec<Line<T>>,
    dc: Vec<Line<T>>,
    dh_before: Vec<Line<T>>,
    dc_before: Vec<Line<T>>,
    /// By the pre-activations of each row that went on, of the steps that are being gathered.
    dz: Vec<Line<T>>,
    gathered: Vec<Segment>,
    /// By those of each event, of this step or of all.
    dz_sum: Vec<Line<T>>,
    /// By the head values, of all steps.
    dy: Vec<T>,
    dx: Vec<T>,
    wanted: Gradients,
    gradient: Gradient<T>,
    own: Own<T>,
}

impl<T> Back<T> {
    /// Where the derivatives by the pre-activations of a step's events lie: those of other steps are kept beside them, or are
    /// written over.
    fn sums(&self, step: Step, lines: usize) -> Range<usize> {
        let start = if self.wanted == Gradients::Own { step.read * lines } else { 0 };
        start..start + step.events * lines
    }
}

impl<T: Real> Passes<T> {
    /// Every window on its own.
    ///
    /// # Panics
    /// When the network reads more than the paper's four inputs: what else a window could be told depends on where it starts.
    #[must_use]
    pub fn windows(layout: Layout) -> Self {
        assert_eq!(layout.inputs, super::INPUTS, "windows read the paper's four inputs");
        Self::new(layout, Rows::Windows)
    }

    /// One state along each event: it starts at zero, and answers at every step from `horizon` − 1 on.
    #[must_use]
    pub fn carried(layout: Layout) -> Self {
        Self::new(layout, Rows::Carried)
    }

    fn new(layout: Layout, kind: Rows) -> Self {
        let empty = Vec::new;
        Self {
            layout,
            kind,
            plan: Plan::default(),
            inputs: Vec::new(),
            z: empty(),
            c: empty(),
            h: empty(),
            projected: empty(),
            outputs: Vec::new(),
            back: Back {
                dh: empty(),
                dc: empty(),
                dh_before: empty(),
                dc_before: empty(),
                dz: empty(),
                gathered: Vec::new(),
                dz_sum: empty(),
                dy: Vec::new(),
                dx: Vec::new(),
                wanted: Gradients::Summed,
                gradient: Gradient::new(layout),
                own: Own::new(),
            },
        }
    }

    /// Begins with events of these many input steps each, longest first.
    ///
    /// # Panics
    /// When they are not sorted.
    pub fn begin(&mut self, horizon: usize, input_steps: &[usize]) {
        match self.kind {
            Rows::Windows => self.plan.windows(horizon, input_steps),
            Rows::Carried => self.plan.carried(horizon, input_steps),
        }
        let (units, rows, steps) = (lines(self.layout.hidden), self.plan.rows(), self.plan.steps());
        let most = |of: fn(&Step) -> usize| steps.iter().map(of).max().unwrap_or(0);
        let (most_rows, most_events) = (most(|step| step.rows), most(|step| step.events));
        self.inputs.resize(self.plan.read() * self.layout.inputs, T::zero());
        grow(&mut self.z, rows * GATES * units);
        grow(&mut self.c, rows * units);
        grow(&mut self.h, rows * units);
        grow(&mut self.projected, most_events * GATES * units);
        let Back { dh, dc, dh_before, dc_before, dz, dz_sum, .. } = &mut self.back;
        for buffer in [dh, dc, dh_before, dc_before] {
            grow(buffer, most_rows * units);
        }
        grow(dz, (GATHERED + most_rows) * GATES * units);
        grow(dz_sum, most_events * GATES * units);
    }

    /// Turns round after the last step, or once more after the first.
    pub fn turn(&mut self, wanted: Gradients) {
        let gates = GATES * lines(self.layout.hidden);
        self.back.wanted = wanted;
        self.back.gathered.clear();
        match wanted {
            Gradients::Summed => self.back.gradient.clear(),
            Gradients::Own => {
                let (rows, read) = (self.plan.rows(), self.plan.read());
                grow(&mut self.back.dz, rows * gates);
                grow(&mut self.back.dz_sum, read * gates);
                self.back.dy.resize(read, T::zero());
            }
        }
    }

    /// Input steps of the longest event.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.plan.steps().len()
    }

    /// Events that step `t` reads: a prefix.
    #[must_use]
    pub fn events(&self, t: usize) -> usize {
        self.plan.steps()[t].events
    }

    /// Events that answer at step `t`: a prefix.
    #[must_use]
    pub fn answering(&self, t: usize) -> usize {
        self.plan.steps()[t].answering
    }

    /// Advances every row of step `t` by the inputs (`events(t)` × inputs); returns one head value per answering event.
    ///
    /// # Panics
    /// When the number of inputs does not fit.
    pub fn forward(&mut self, network: &Network<T>, t: usize, inputs: &[T]) -> &[T] {
        let (lines, step) = (GATES * lines(self.layout.hidden), self.plan.steps()[t]);
        assert_eq!(inputs.len(), step.events * self.layout.inputs);
        self.inputs[step.read * self.layout.inputs..][..inputs.len()].copy_from_slice(inputs);
        let mut projected = std::mem::take(&mut self.projected);
        network.project(inputs, &mut projected[..step.events * lines]);
        self.advance(network, t, Lines::new(&projected[..step.events * lines], step.events), 0);
        self.projected = projected;
        &self.outputs
    }

    /// The same from projected inputs, those of the first event in row `first`. Who does not tell the inputs themselves cannot have
    /// the derivatives by their weights from here.
    pub(super) fn advance(&mut self, network: &Network<T>, t: usize, projected: Lines<'_, T>, first: usize) -> &[T] {
        let (units, step) = (lines(self.layout.hidden), self.plan.steps()[t]);
        let (c_before, c) = self.c.split_at_mut(step.start * units);
        let (h_before, h) = self.h.split_at_mut(step.start * units);
        let before = self.plan.before(t);
        let h = &mut h[..step.rows * units];
        T::run(Forward {
            weights: &network.to_gates,
            events: self.plan.events(step),
            begun: step.begun,
            projected,
            first,
            h_before: of_step(h_before, before, units),
            c_before: of_step(c_before, before, units),
            z: &mut self.z[step.start * GATES * units..][..step.rows * GATES * units],
            c: &mut c[..step.rows * units],
            h,
        });
        self.outputs.resize(step.answering, T::zero());
        let rows = Lines::new(h, step.rows);
        let (first, out) = (step.rows - step.answering, &mut self.outputs);
        T::run(Dots { vectors: &network.head, lines: units, rows, first, out });
        for y in &mut self.outputs {
            *y += network.head_bias();
        }
        &self.outputs
    }

    /// Goes back through step `t`: `dy` is the derivative by each answering event's head value.
    ///
    /// # Panics
    /// When the number of derivatives does not fit.
    pub fn backward(&mut self, network: &Network<T>, t: usize, dy: &[T]) {
        let (units, step) = (lines(self.layout.hidden), self.plan.steps()[t]);
        assert_eq!(dy.len(), step.answering);
        let left = self.plan.steps().get(t + 1).map_or(0, |next| next.later());
        self.head_backward(network, step, left, dy);
        self.states_backward(network, t);
        let (inputs, outputs) = (step.read * self.layout.inputs, GATES * units);
        let inputs = &self.inputs[inputs..][..step.events * self.layout.inputs];
        let sums = self.back.sums(step, outputs);
        let Back { dz_sum, dy: all_dy, wanted, gradient, .. } = &mut self.back;
        match wanted {
            Gradients::Summed => {
                let dz = Lines::new(&dz_sum[sums], step.events);
                T::run(ProjectBackward { inputs, dz, sums: &mut gradient.input, outputs });
            }
            Gradients::Own => all_dy[step.read..][..dy.len()].copy_from_slice(dy),
        }
        std::mem::swap(&mut self.back.dh, &mut self.back.dh_before);
        std::mem::swap(&mut self.back.dc, &mut self.back.dc_before);
        if self.back.wanted == Gradients::Summed
            && self.back.gathered.iter().map(|of| of.rows).sum::<usize>() >= GATHERED
        {
            self.gather();
        }
    }

    /// The derivative by the inputs of step `t`, `events(t)` × inputs, straight after it was gone back through; the open loop has
    /// no use for it. `dx = W_ihᵀ Σ dz`, the sum running over the rows that read the same input.
    pub fn by_inputs(&mut self, network: &Network<T>, t: usize) -> &[T] {
        let (step, lines) = (self.plan.steps()[t], GATES * lines(self.layout.hidden));
        let sums = self.back.sums(step, lines);
        let Back { dz_sum, dx, .. } = &mut self.back;
        dx.resize(step.events * self.layout.inputs, T::zero());
        let rows = Lines::new(&dz_sum[sums], step.events);
        T::run(Dots { vectors: &network.input, lines, rows, first: 0, out: dx });
        dx
    }

    /// Puts the derivative by the answering states behind those that the step after gave, for the first `left` rows.
    fn head_backward(&mut self, network: &Network<T>, step: Step, left: usize, dy: &[T]) {
        let units = lines(self.layout.hidden);
        let Back { dh, dc, gradient, .. } = &mut self.back;
        let dh = &mut dh[..step.rows * units];
        for buffer in [&mut *dh, &mut dc[..step.rows * units]] {
            buffer.chunks_exact_mut(step.rows).for_each(|line| line[left..].fill(Line::zero()));
        }
        let first = step.rows - step.answering;
        let h = Lines::new(&self.h[step.start * units..][..step.rows * units], step.rows);
        T::run(HeadBackward { head: &network.head, h, first, dy, dh, sums: &mut gradient.head });
        gradient.head_bias += dy.iter().fold(T::zero(), |sum, dy| sum + *dy);
    }

    /// From the derivatives by the states after the step to those by its pre-activations and by the states before it.
    fn states_backward(&mut self, network: &Network<T>, t: usize) {
        let (units, step, before) = (lines(self.layout.hidden), self.plan.steps()[t], self.plan.before(t));
        let states = step.rows * units;
        let sums = self.back.sums(step, GATES * units);
        let Back { dh, dc, dh_before, dc_before, dz, gathered, dz_sum, .. } = &mut self.back;
        let from = gathered.last().map_or(0, |last| last.dz + last.rows * GATES * units);
        let dz = &mut dz[from..][..step.later() * GATES * units];
        let dz_sum = &mut dz_sum[sums];
        dz_sum.fill(Line::zero());
        let (c_before, c) = self.c.split_at(step.start * units);
        T::run(ThroughGates {
            events: self.plan.events(step),
            begun: step.begun,
            z: Lines::new(&self.z[step.start * GATES * units..][..step.rows * GATES * units], step.rows),
            c: Lines::new(&c[..states], step.rows),
            c_before: of_step(c_before, before, units),
            dh: Lines::new(&dh[..states], step.rows),
            dc: Lines::new(&dc[..states], step.rows),
            dz,
            dz_sum,
            summed: step.events,
            dc_before,
            rows_before: before.map_or(0, |before| before.rows),
        });
        if let Some(before) = before.filter(|_| step.later() > 0) {
            let later = step.later();
            let weights = &network.to_states;
            let dh_before = &mut dh_before[..before.rows * units];
            T::run(ThroughWeights { weights, dz: Lines::new(dz, later), later, dh_before, rows_before: before.rows });
            gathered.push(Segment { rows: later, dz: from, h: before.start * units, h_rows: before.rows });
        }
    }

    /// Adds up the outer products of the steps that wait.
    fn gather(&mut self) {
        let Back { dz, gathered, gradient, .. } = &mut self.back;
        let (segments, sums, lines) = (&gathered[..], &mut gradient.recurrent, lines(self.layout.hidden));
        T::run(OuterProducts { segments, dz, h: &self.h, lines, outputs: GATES * lines * LINE, sums });
        gathered.clear();
    }

    /// Adds the derivatives by all weights to `gradient`, once every step was gone back through.
    ///
    /// # Panics
    /// When [`Gradients::Own`] were asked for.
    pub fn finish(&mut self, gradient: &mut [T]) {
        assert_eq!(self.back.wanted, Gradients::Summed, "the sum was asked for");
        self.gather();
        self.back.gradient.add_to(gradient);
    }
}

/// The lines of a step, among those of all steps.
fn of_step<T>(values: &[Line<T>], step: Option<Step>, lines: usize) -> Lines<'_, T> {
    match step {
        Some(step) => Lines::new(&values[step.start * lines..][..step.rows * lines], step.rows),
        None => Lines::new(&[], 0),
    }
}
