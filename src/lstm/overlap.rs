//! Forward and backward through all windows of some events, the overlapping ones of a step together.

use super::buffer::grow;
use super::plan::Plan;
use super::product::{columns, product, rows};
use super::{INPUTS, Layout, Real, gates, vectorised};

/// Activations of all windows of some events, and the passes over them. Buffers are kept for the next set of events.
///
/// Use: [`Overlap::begin`], then [`Overlap::forward`] for each step in order, then [`Overlap::backward`] for each in reverse,
/// then [`Overlap::finish`].
#[derive(Debug)]
pub struct Overlap<T> {
    pub(super) layout: Layout,
    pub(super) plan: Plan,
    /// Inputs of every step, `events(t)` × 4 each.
    pub(super) inputs: Vec<T>,
    pub(super) input_row: Vec<usize>,
    /// Gates, later their derivatives: of first steps and of later ones.
    pub(super) first_z: Vec<T>,
    pub(super) carried_z: Vec<T>,
    /// States that a later step reads, at that step's rows.
    pub(super) carried_h: Vec<T>,
    carried_c: Vec<T>,
    /// States at the end of each window.
    pub(super) answer_h: Vec<T>,
    answer_c: Vec<T>,
    /// Derivatives by the outputs, kept for [`Self::add_magnitudes`].
    pub(super) answer_dy: Vec<T>,
    scratch: Scratch<T>,
}

/// Values of one step.
#[derive(Debug)]
struct Scratch<T> {
    projected: Vec<T>,
    dz_sum: Vec<T>,
    dh: Vec<T>,
    dc: Vec<T>,
    dc_before: Vec<T>,
    outputs: Vec<T>,
    dx: Vec<T>,
}

impl<T: Real> Overlap<T> {
    /// Empty buffers for a network of this layout.
    ///
    /// # Panics
    /// When it does not read the paper's four inputs: what else a window could be told depends on where it starts.
    #[must_use]
    pub fn new(layout: Layout) -> Self {
        assert_eq!(layout.inputs, INPUTS, "windows read the paper's four inputs");
        let empty = Vec::new;
        Self {
            layout,
            plan: Plan::default(),
            inputs: empty(),
            input_row: Vec::new(),
            first_z: empty(),
            carried_z: empty(),
            carried_h: empty(),
            carried_c: empty(),
            answer_h: empty(),
            answer_c: empty(),
            answer_dy: empty(),
            scratch: Scratch {
                projected: empty(),
                dz_sum: empty(),
                dh: empty(),
                dc: empty(),
                dc_before: empty(),
                outputs: empty(),
                dx: empty(),
            },
        }
    }

    /// Begins with events of these many input steps each, longest first.
    pub fn begin(&mut self, horizon: usize, input_steps: &[usize]) {
        self.plan.set(horizon, input_steps);
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let (windows, carried) = (self.plan.windows(), self.plan.all_carried());
        self.input_row.clear();
        let mut inputs = 0;
        for t in 0..self.plan.steps() {
            self.input_row.push(inputs);
            inputs += self.plan.events(t) * INPUTS;
        }
        grow(&mut self.inputs, inputs);
        grow(&mut self.first_z, windows * gates);
        grow(&mut self.carried_z, carried * gates);
        for buffer in [&mut self.carried_h, &mut self.carried_c] {
            grow(buffer, carried * hidden);
        }
        for buffer in [&mut self.answer_h, &mut self.answer_c] {
            grow(buffer, windows * hidden);
        }
        grow(&mut self.answer_dy, windows);
    }

    /// Input steps of the longest event.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.plan.steps()
    }

    /// Events that step `t` reads: a prefix.
    #[must_use]
    pub fn events(&self, t: usize) -> usize {
        self.plan.events(t)
    }

    /// Events that answer at step `t`: a prefix.
    #[must_use]
    pub fn answering(&self, t: usize) -> usize {
        self.plan.answering(t).len()
    }

    /// Advances every window alive at step `t` by the inputs (`events(t)` × 4); returns one head value per answering event.
    ///
    /// # Panics
    /// When the number of inputs does not fit.
    pub fn forward(&mut self, weights: &[T], t: usize, inputs: &[T]) -> &[T] {
        let (layout, hidden, gates) = (self.layout, self.layout.hidden, self.layout.gates());
        assert_eq!(inputs.len(), self.plan.events(t) * INPUTS);
        let kept = self.input_row[t];
        self.inputs[kept..kept + inputs.len()].copy_from_slice(inputs);
        self.project(weights, inputs);

        let carried = self.plan.carried(t);
        let z = &mut self.carried_z[carried.start * gates..carried.end * gates];
        if !carried.is_empty() {
            let recurrent = rows(&weights[layout.recurrent()], gates, hidden);
            let before = &self.carried_h[carried.start * hidden..carried.end * hidden];
            product(z, 0.0, &recurrent, &columns(before, hidden, carried.len()));
        }

        let (first, answers) = (self.plan.first(t), self.plan.answering(t));
        let first_z = &mut self.first_z[first.start * gates..first.end * gates];
        let (before_c, next_c) = self.carried_c.split_at_mut(carried.end * hidden);
        let before_c = &before_c[carried.start * hidden..];
        let next_h = &mut self.carried_h[carried.end * hidden..];
        let answer_c = &mut self.answer_c[answers.start * hidden..answers.end * hidden];
        let answer_h = &mut self.answer_h[answers.start * hidden..answers.end * hidden];
        let projected = &self.scratch.projected;
        let plan = &self.plan;
        let staying = carried.len() - answers.len();
        vectorised(
            #[inline(always)]
            || {
                let row = |n: usize, width: usize| n * width..(n + 1) * width;
                for n in 0..first.len() {
                    let (c, h) = (&mut next_c[row(n, hidden)], &mut next_h[row(n, hidden)]);
                    gates::first(&mut first_z[row(n, gates)], &projected[row(n, gates)], c, h);
                }
                for slot in plan.slots(t) {
                    for r in slot.clone() {
                        let p = &projected[row(r - slot.start, gates)];
                        let (c, h) = if r < staying {
                            let to = row(first.len() + r, hidden);
                            (&mut next_c[to.clone()], &mut next_h[to])
                        } else {
                            let to = row(r - staying, hidden);
                            (&mut answer_c[to.clone()], &mut answer_h[to])
                        };
                        gates::later(&mut z[row(r, gates)], p, &before_c[row(r, hidden)], c, h);
                    }
                }
            },
        );
        self.head(weights, t)
    }

    /// `projected = W_ih x + b`, one row per event.
    fn project(&mut self, weights: &[T], inputs: &[T]) {
        let gates = self.layout.gates();
        let events = inputs.len() / INPUTS;
        grow(&mut self.scratch.projected, events * gates);
        let projected = &mut self.scratch.projected[..events * gates];
        let (input, bias) = (&weights[self.layout.input()], &weights[self.layout.bias()]);
        vectorised(
            #[inline(always)]
            || {
                for (p, x) in projected.chunks_exact_mut(gates).zip(inputs.chunks_exact(INPUTS)) {
                    for ((p, w), b) in p.iter_mut().zip(input.chunks_exact(INPUTS)).zip(bias) {
                        *p = w[3].fma(x[3], w[2].fma(x[2], w[1].fma(x[1], w[0].fma(x[0], *b))));
                    }
                }
            },
        );
    }

    fn head(&mut self, weights: &[T], t: usize) -> &[T] {
        let hidden = self.layout.hidden;
        let answers = self.plan.answering(t);
        let states = &self.answer_h[answers.start * hidden..answers.end * hidden];
        let (head, bias) = (&weights[self.layout.head()], weights[self.layout.head_bias()]);
        self.scratch.outputs.clear();
        self.scratch.outputs.extend(states.chunks_exact(hidden).map(|h| super::encode::dot(head, h) + bias));
        &self.scratch.outputs
    }

    /// Goes back through step `t`: `dy` is the derivative by each answering event's head value. Adds to `gradient` what does
    /// not wait for [`Self::finish`] and returns the derivative by the step's inputs, `events(t)` × 4.
    ///
    /// # Panics
    /// When the number of derivatives does not fit.
    pub fn backward(&mut self, weights: &[T], t: usize, dy: &[T], gradient: &mut [T]) -> &[T] {
        let answers = self.plan.answering(t);
        assert_eq!(dy.len(), answers.len());
        self.answer_dy[answers.clone()].copy_from_slice(dy);
        self.head_backward(weights, t, dy, gradient);
        self.gates_backward(t);
        self.input_backward(weights, t, gradient);

        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let carried = self.plan.carried(t);
        grow(&mut self.scratch.dh, carried.len() * hidden);
        if !carried.is_empty() {
            let dz = &self.carried_z[carried.start * gates..carried.end * gates];
            let transposed = columns(&weights[self.layout.recurrent()], hidden, gates);
            let dh = &mut self.scratch.dh[..carried.len() * hidden];
            product(dh, 0.0, &transposed, &columns(dz, gates, carried.len()));
        }
        std::mem::swap(&mut self.scratch.dc, &mut self.scratch.dc_before);
        &self.scratch.dx
    }

    /// Leaves the derivative by the answering states behind those of the carried ones.
    fn head_backward(&mut self, weights: &[T], t: usize, dy: &[T], gradient: &mut [T]) {
        let hidden = self.layout.hidden;
        let answers = self.plan.answering(t);
        // What step t leaves behind: the rows that step t + 1 gave derivatives for.
        let left = self.plan.first(t).len() + self.plan.carried(t).len() - answers.len();
        for buffer in [&mut self.scratch.dh, &mut self.scratch.dc] {
            grow(buffer, (left + answers.len()) * hidden);
            buffer[left * hidden..(left + answers.len()) * hidden].fill(T::zero());
        }
        let head = &weights[self.layout.head()];
        let states = &self.answer_h[answers.start * hidden..answers.end * hidden];
        let dh = &mut self.scratch.dh[left * hidden..(left + answers.len()) * hidden];
        let (begin, end) = (self.layout.head().start, self.layout.head_bias());
        for ((dy, h), dh) in dy.iter().zip(states.chunks_exact(hidden)).zip(dh.chunks_exact_mut(hidden)) {
            for (dh, w) in dh.iter_mut().zip(head) {
                *dh = *dy * *w;
            }
            for (dw, h) in gradient[begin..end].iter_mut().zip(h) {
                *dw += *dy * *h;
            }
            gradient[end] += *dy;
        }
    }

    fn gates_backward(&mut self, t: usize) {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let (first, carried, answers) = (self.plan.first(t), self.plan.carried(t), self.plan.answering(t));
        let events = self.plan.events(t);
        let Scratch { dz_sum, dh, dc, dc_before, .. } = &mut self.scratch;
        grow(dc_before, carried.len() * hidden);
        grow(dz_sum, events * gates);
        dz_sum[..events * gates].fill(T::zero());
        let first_z = &mut self.first_z[first.start * gates..first.end * gates];
        let z = &mut self.carried_z[carried.start * gates..carried.end * gates];
        let (before_c, next_c) = self.carried_c.split_at(carried.end * hidden);
        let before_c = &before_c[carried.start * hidden..];
        let answer_c = &self.answer_c[answers.start * hidden..answers.end * hidden];
        let plan = &self.plan;
        let staying = carried.len() - answers.len();
        vectorised(
            #[inline(always)]
            || {
                let row = |n: usize, width: usize| n * width..(n + 1) * width;
                for n in 0..first.len() {
                    let (c, at) = (&next_c[row(n, hidden)], row(n, hidden));
                    let sum = &mut dz_sum[row(n, gates)];
                    gates::first_backward(&mut first_z[row(n, gates)], c, &dh[at.clone()], &dc[at], sum);
                }
                for slot in plan.slots(t) {
                    for r in slot.clone() {
                        let c = if r < staying {
                            &next_c[row(first.len() + r, hidden)]
                        } else {
                            &answer_c[row(r - staying, hidden)]
                        };
                        let at = row(first.len() + r, hidden);
                        gates::later_backward(
                            &mut z[row(r, gates)],
                            c,
                            &before_c[row(r, hidden)],
                            &dh[at.clone()],
                            &dc[at],
                            &mut dc_before[row(r, hidden)],
                            &mut dz_sum[row(r - slot.start, gates)],
                        );
                    }
                }
            },
        );
    }

    /// `dx = W_ihᵀ Σ dz`, `dW_ih += Σ dz xᵀ`, `db += Σ dz`, the sum running over the windows that share the input.
    fn input_backward(&mut self, weights: &[T], t: usize, gradient: &mut [T]) {
        let gates = self.layout.gates();
        let events = self.plan.events(t);
        let inputs = &self.inputs[self.input_row[t]..self.input_row[t] + events * INPUTS];
        let dz_sum = &self.scratch.dz_sum[..events * gates];
        let input = &weights[self.layout.input()];
        let (input_gradient, rest) = gradient.split_at_mut(self.layout.input().end);
        let bias_gradient = &mut rest[self.layout.bias().start - self.layout.input().end..][..gates];
        self.scratch.dx.clear();
        self.scratch.dx.resize(events * INPUTS, T::zero());
        let dx = &mut self.scratch.dx;
        vectorised(
            #[inline(always)]
            || {
                for ((dz, x), dx) in
                    dz_sum.chunks_exact(gates).zip(inputs.chunks_exact(INPUTS)).zip(dx.chunks_exact_mut(INPUTS))
                {
                    let mut sums = [T::zero(); INPUTS];
                    let each = dz.iter().zip(input.chunks_exact(INPUTS)).zip(input_gradient.chunks_exact_mut(INPUTS));
                    for (((dz, w), dw), db) in each.zip(bias_gradient.iter_mut()) {
                        for k in 0..INPUTS {
                            sums[k] = dz.fma(w[k], sums[k]);
                            dw[k] = dz.fma(x[k], dw[k]);
                        }
                        *db += *dz;
                    }
                    dx.copy_from_slice(&sums);
                }
            },
        );
    }

    /// The recurrent weights' gradient, over all steps in one long product: `dW_hh += Σ dz h'ᵀ`.
    pub fn finish(&mut self, gradient: &mut [T]) {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let carried = self.plan.all_carried();
        if carried == 0 {
            return;
        }
        // dW_hh is row-major gates × hidden, which is column-major hidden × gates.
        let states = columns(&self.carried_h[..carried * hidden], hidden, carried);
        let dz = rows(&self.carried_z[..carried * gates], carried, gates);
        product(&mut gradient[self.layout.recurrent()], 1.0, &states, &dz);
    }
}
