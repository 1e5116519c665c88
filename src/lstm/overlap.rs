//! Forward and backward through all windows of some events, the overlapping ones of a step together.

use super::buffer::grow;
use super::gates::{First, FirstBackward, Later, LaterBackward};
use super::lanes::{Lanes, Units, each_unit};
use super::plan::Plan;
use super::product::{columns, product, rows};
use super::{INPUTS, Layout, Network, Real};

/// Activations of all windows of some events, and the passes over them. Buffers are kept for the next set of events.
///
/// Use: [`Overlap::begin`], then [`Overlap::forward`] for each step in order, then [`Overlap::backward`] for each in reverse, then
/// [`Overlap::finish`].
#[derive(Debug)]
pub struct Overlap<T> {
    layout: Layout,
    plan: Plan,
    /// Inputs of every step, `events(t)` × 4 each.
    inputs: Vec<T>,
    input_row: Vec<usize>,
    /// Gates of first steps and of later ones.
    first_z: Vec<T>,
    carried_z: Vec<T>,
    /// States that a later step reads, at that step's rows.
    carried_h: Vec<T>,
    carried_c: Vec<T>,
    /// States at the end of each window.
    answer_h: Vec<T>,
    answer_c: Vec<T>,
    /// Of the input weights and the bias so far, as [`InputGradient`] has them.
    input_gradient: Vec<T>,
    scratch: Scratch<T>,
}

/// Values of one step.
#[derive(Debug)]
struct Scratch<T> {
    projected: Vec<T>,
    /// By the gates' pre-activations: of each later row, and summed over the windows that share an input.
    dz: Vec<T>,
    dz_sum: Vec<T>,
    /// By the states after the step, and by those before it.
    dh: Vec<T>,
    dc: Vec<T>,
    dh_before: Vec<T>,
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
            input_gradient: empty(),
            scratch: Scratch {
                projected: empty(),
                dz: empty(),
                dz_sum: empty(),
                dh: empty(),
                dc: empty(),
                dh_before: empty(),
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
        self.input_gradient.clear();
        self.input_gradient.resize((INPUTS + 1) * gates, T::zero());
        for buffer in [&mut self.answer_h, &mut self.answer_c] {
            grow(buffer, windows * hidden);
        }
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
    pub fn forward(&mut self, network: &Network<T>, t: usize, inputs: &[T]) -> &[T] {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        assert_eq!(inputs.len(), self.plan.events(t) * INPUTS);
        let kept = self.input_row[t];
        self.inputs[kept..kept + inputs.len()].copy_from_slice(inputs);
        let events = self.plan.events(t);
        grow(&mut self.scratch.projected, events * gates);
        network.project(inputs, &mut self.scratch.projected[..events * gates]);

        let (first, carried, answers) = (self.plan.first(t), self.plan.carried(t), self.plan.answering(t));
        let first_z = &mut self.first_z[first.start * gates..first.end * gates];
        let z = &mut self.carried_z[carried.start * gates..carried.end * gates];
        let (before_c, next_c) = self.carried_c.split_at_mut(carried.end * hidden);
        let (before_h, next_h) = self.carried_h.split_at_mut(carried.end * hidden);
        let (before_c, before_h) = (&before_c[carried.start * hidden..], &before_h[carried.start * hidden..]);
        let answer_c = &mut self.answer_c[answers.start * hidden..answers.end * hidden];
        let answer_h = &mut self.answer_h[answers.start * hidden..answers.end * hidden];
        let projected = &self.scratch.projected;
        let begun = first.len() * hidden;
        let (c, h) = (&mut next_c[..begun], &mut next_h[..begun]);
        each_unit(First { hidden, p: &projected[..first.len() * gates], z: first_z, c, h });
        network.forward.multiply(&before_h[..carried.len() * hidden], z);
        for slot in self.plan.slots(t) {
            let (state, gate) = (slot.start * hidden..slot.end * hidden, slot.start * gates..slot.end * gates);
            // The last slot answers; the others go on behind the rows that have just begun.
            let (c, h) = if slot.end == carried.len() && !answers.is_empty() {
                (&mut *answer_c, &mut *answer_h)
            } else {
                let next = begun + state.start..begun + state.end;
                (&mut next_c[next.clone()], &mut next_h[next])
            };
            let p = &projected[..slot.len() * gates];
            each_unit(Later { hidden, p, z: &mut z[gate], before: &before_c[state], c, h });
        }
        network.heads(answer_h, &mut self.scratch.outputs);
        &self.scratch.outputs
    }

    /// Goes back through step `t`: `dy` is the derivative by each answering event's head value. Adds to `gradient` what does
    /// not wait for [`Self::finish`].
    ///
    /// # Panics
    /// When the number of derivatives does not fit.
    pub fn backward(&mut self, network: &Network<T>, t: usize, dy: &[T], gradient: &mut [T]) {
        assert_eq!(dy.len(), self.plan.answering(t).len());
        self.head_backward(network.weights(), t, dy, gradient);
        self.gates_backward(network, t);
        self.recurrent_backward(t, gradient);
        self.input_backward(t);
        std::mem::swap(&mut self.scratch.dh, &mut self.scratch.dh_before);
        std::mem::swap(&mut self.scratch.dc, &mut self.scratch.dc_before);
    }

    /// The derivative by the inputs of step `t`, `events(t)` × 4, straight after going back through it: `dx = W_ihᵀ Σ dz`.
    pub fn by_inputs(&mut self, network: &Network<T>, t: usize) -> &[T] {
        let dz = &self.scratch.dz_sum[..self.plan.events(t) * self.layout.gates()];
        network.back_project(dz, &mut self.scratch.dx);
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

    /// From the derivatives by the states after the step to those by its gates and by the states before it.
    fn gates_backward(&mut self, network: &Network<T>, t: usize) {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let (first, carried, answers) = (self.plan.first(t), self.plan.carried(t), self.plan.answering(t));
        let events = self.plan.events(t);
        let Scratch { dz, dz_sum, dh, dc, dh_before, dc_before, .. } = &mut self.scratch;
        for buffer in [&mut *dh_before, dc_before] {
            grow(buffer, carried.len() * hidden);
        }
        grow(dz, carried.len() * gates);
        grow(dz_sum, events * gates);
        dz_sum[..events * gates].fill(T::zero());
        let first_z = &self.first_z[first.start * gates..first.end * gates];
        let z = &self.carried_z[carried.start * gates..carried.end * gates];
        let (before_c, next_c) = self.carried_c.split_at(carried.end * hidden);
        let before_c = &before_c[carried.start * hidden..];
        let answer_c = &self.answer_c[answers.start * hidden..answers.end * hidden];
        let begun = first.len() * hidden;
        let sum = &mut dz_sum[..first.len() * gates];
        each_unit(FirstBackward { hidden, z: first_z, c: &next_c[..begun], dh: &dh[..begun], dc: &dc[..begun], sum });
        for slot in self.plan.slots(t) {
            let (state, gate) = (slot.start * hidden..slot.end * hidden, slot.start * gates..slot.end * gates);
            let after = begun + state.start..begun + state.end;
            let answers = slot.end == carried.len() && !answers.is_empty();
            each_unit(LaterBackward {
                hidden,
                z: &z[gate.clone()],
                c: if answers { answer_c } else { &next_c[after.clone()] },
                before: &before_c[state.clone()],
                dh: &dh[after.clone()],
                dc: &dc[after],
                dz: &mut dz[gate.clone()],
                dc_before: &mut dc_before[state.clone()],
                sum: Some(&mut dz_sum[..slot.len() * gates]),
            });
        }
        network.backward.multiply(&dz[..carried.len() * gates], &mut dh_before[..carried.len() * hidden]);
    }

    /// `dW_hh += Σ dz h'ᵀ`, over the later rows of this step while they are in the cache.
    fn recurrent_backward(&self, t: usize, gradient: &mut [T]) {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let carried = self.plan.carried(t);
        if carried.is_empty() {
            return;
        }
        // dW_hh is row-major gates × hidden, which is column-major hidden × gates.
        let states = columns(&self.carried_h[carried.start * hidden..carried.end * hidden], hidden, carried.len());
        let dz = rows(&self.scratch.dz[..carried.len() * gates], carried.len(), gates);
        product(&mut gradient[self.layout.recurrent()], 1.0, &states, &dz);
    }

    /// `dW_ih += Σ dz xᵀ`, `db += Σ dz`, the sum running over the windows that share the input.
    fn input_backward(&mut self, t: usize) {
        let events = self.plan.events(t);
        let inputs = &self.inputs[self.input_row[t]..self.input_row[t] + events * INPUTS];
        let dz = &self.scratch.dz_sum[..events * self.layout.gates()];
        each_unit(InputGradient { inputs, dz, sums: &mut self.input_gradient });
    }

    /// Adds what of the gradient waited for all steps. From here on the steps may be gone back through once more.
    pub fn finish(&mut self, gradient: &mut [T]) {
        let gates = self.layout.gates();
        let sum = |k: usize, gate: usize| self.input_gradient[k * gates + gate];
        for (at, g) in gradient[self.layout.input()].iter_mut().enumerate() {
            *g += sum(at % INPUTS, at / INPUTS);
        }
        for (gate, g) in gradient[self.layout.bias()].iter_mut().enumerate() {
            *g += sum(INPUTS, gate);
        }
        self.input_gradient.fill(T::zero());
    }
}

/// Adds to the gradients of the input weights and the bias, (inputs + 1) × gates: gates lie beside each other.
struct InputGradient<'a, T> {
    inputs: &'a [T],
    dz: &'a [T],
    sums: &'a mut [T],
}

impl<T: Real> Units<T> for InputGradient<'_, T> {
    #[inline(always)]
    fn size(&self) -> (usize, usize) {
        (1, self.sums.len() / (INPUTS + 1))
    }

    #[inline(always)]
    fn unit<L: Lanes<Number = T>>(&mut self, l: L, _: usize, gate: usize) {
        let gates = self.sums.len() / (INPUTS + 1);
        let mut sums: [L::Value; INPUTS + 1] = std::array::from_fn(
            #[inline(always)]
            |k| l.load(&self.sums[k * gates + gate..]),
        );
        for (x, dz) in self.inputs.as_chunks::<INPUTS>().0.iter().zip(self.dz.chunks_exact(gates)) {
            let dz = l.load(&dz[gate..]);
            for k in 0..INPUTS {
                sums[k] = l.fma(dz, l.splat(x[k]), sums[k]);
            }
            sums[INPUTS] = l.add(sums[INPUTS], dz);
        }
        for k in 0..=INPUTS {
            l.store(&mut self.sums[k * gates + gate..], sums[k]);
        }
    }
}
