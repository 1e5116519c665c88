//! Forward and backward along some events with one state each, from their first step to their last.

use super::buffer::grow;
use super::gates::{First, FirstBackward, Later, LaterBackward};
use super::lanes::each_unit;
use super::product::{columns, product, rows};
use super::{Layout, Network, Real};

/// Activations of every step of some events, and the passes over them. Buffers are kept for the next set of events.
///
/// Use as [`super::Overlap`]: [`Carried::begin`], [`Carried::forward`] for each step in order, [`Carried::backward`] for each
/// in reverse, [`Carried::finish`]. The state starts at zero; from step `horizon` − 1 on every event answers at every step.
#[derive(Debug)]
pub struct Carried<T> {
    layout: Layout,
    horizon: usize,
    /// Events alive at each step: the number of those that are long enough.
    alive: Vec<usize>,
    /// Prefix sums of `alive`.
    row: Vec<usize>,
    inputs: Vec<T>,
    /// Gates.
    z: Vec<T>,
    /// Derivatives by their pre-activations.
    dz: Vec<T>,
    /// States after each step.
    h: Vec<T>,
    c: Vec<T>,
    /// Derivatives by the head values, at the rows of those that answer.
    dy: Vec<T>,
    dh: Vec<T>,
    dc: Vec<T>,
    dh_before: Vec<T>,
    dc_before: Vec<T>,
    outputs: Vec<T>,
    dx: Vec<T>,
    projected: Vec<T>,
    own: Own<T>,
}

/// What one event left behind, step by step.
#[derive(Debug)]
struct Own<T> {
    inputs: Vec<T>,
    dz: Vec<T>,
    h: Vec<T>,
}

impl<T: Real> Carried<T> {
    /// Empty buffers for a network of this layout.
    #[must_use]
    pub fn new(layout: Layout) -> Self {
        let empty = Vec::new;
        Self {
            layout,
            horizon: 0,
            alive: Vec::new(),
            row: Vec::new(),
            inputs: empty(),
            z: empty(),
            dz: empty(),
            h: empty(),
            c: empty(),
            dy: empty(),
            dh: empty(),
            dc: empty(),
            dh_before: empty(),
            dc_before: empty(),
            outputs: empty(),
            dx: empty(),
            projected: empty(),
            own: Own { inputs: empty(), dz: empty(), h: empty() },
        }
    }

    /// Begins with events of these many input steps each, longest first.
    ///
    /// # Panics
    /// When they are not sorted.
    pub fn begin(&mut self, horizon: usize, input_steps: &[usize]) {
        assert!(horizon >= 1 && input_steps.is_sorted_by(|a, b| a >= b), "events come longest first");
        self.horizon = horizon;
        let steps = input_steps.first().copied().unwrap_or(0);
        self.alive.clear();
        self.row.clear();
        let mut rows = 0;
        for t in 0..steps {
            let alive = input_steps.iter().take_while(|&&n| t < n).count();
            self.row.push(rows);
            self.alive.push(alive);
            rows += alive;
        }
        self.row.push(rows);
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        grow(&mut self.inputs, rows * self.layout.inputs);
        grow(&mut self.z, rows * gates);
        grow(&mut self.dz, rows * gates);
        grow(&mut self.h, rows * hidden);
        grow(&mut self.c, rows * hidden);
        grow(&mut self.dy, rows);
        let most = self.alive.first().copied().unwrap_or(0);
        for buffer in [&mut self.dh, &mut self.dc, &mut self.dh_before, &mut self.dc_before] {
            grow(buffer, most * hidden);
            buffer.fill(T::zero());
        }
        grow(&mut self.projected, most * gates);
    }

    /// Input steps of the longest event.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.alive.len()
    }

    /// Events that step `t` reads: a prefix.
    #[must_use]
    pub fn events(&self, t: usize) -> usize {
        self.alive[t]
    }

    /// Events that answer at step `t`: a prefix.
    #[must_use]
    pub fn answering(&self, t: usize) -> usize {
        if t + 1 >= self.horizon { self.alive[t] } else { 0 }
    }

    /// Advances every event alive at step `t` by its inputs; returns one head value per answering event.
    ///
    /// # Panics
    /// When the number of inputs does not fit.
    pub fn forward(&mut self, network: &Network<T>, t: usize, inputs: &[T]) -> &[T] {
        let (layout, hidden, gates) = (self.layout, self.layout.hidden, self.layout.gates());
        let alive = self.alive[t];
        assert_eq!(inputs.len(), alive * layout.inputs);
        let from = self.row[t];
        self.inputs[from * layout.inputs..][..inputs.len()].copy_from_slice(inputs);
        network.project(inputs, &mut self.projected[..alive * gates]);
        let before = if t > 0 { self.row[t - 1] } else { 0 };
        let (h_before, h) = self.h.split_at_mut(from * hidden);
        let (c_before, c) = self.c.split_at_mut(from * hidden);
        let z = &mut self.z[from * gates..][..alive * gates];
        let (p, width) = (&self.projected[..alive * gates], before * hidden);
        let (c, h) = (&mut c[..alive * hidden], &mut h[..alive * hidden]);
        if t == 0 {
            each_unit(First { hidden, p, z, c, h });
        } else {
            network.forward.multiply(&h_before[width..][..alive * hidden], z);
            each_unit(Later { hidden, p, z, before: &c_before[width..][..alive * hidden], c, h });
        }
        let answering = self.answering(t) * hidden;
        network.heads(&self.h[from * hidden..][..answering], &mut self.outputs);
        &self.outputs
    }

    /// Goes back through step `t`: `dy` is the derivative by each answering event's head value. Adds to `gradient` what does
    /// not wait for [`Self::finish`].
    ///
    /// # Panics
    /// When the number of derivatives does not fit.
    pub fn backward(&mut self, network: &Network<T>, t: usize, dy: &[T], gradient: &mut [T]) {
        assert_eq!(dy.len(), self.answering(t));
        self.head_backward(network.weights(), t, dy, gradient);
        self.gates_backward(network, t);
        let (layout, gates) = (self.layout, self.layout.gates());
        let (from, alive) = (self.row[t], self.alive[t]);
        let dz = &self.dz[from * gates..][..alive * gates];
        for row in dz.chunks_exact(gates) {
            for (db, dz) in gradient[layout.bias()].iter_mut().zip(row) {
                *db += *dz;
            }
        }
        std::mem::swap(&mut self.dh, &mut self.dh_before);
        std::mem::swap(&mut self.dc, &mut self.dc_before);
    }

    /// The derivative by the inputs of step `t`, once it was gone back through.
    pub fn by_inputs(&mut self, network: &Network<T>, t: usize) -> &[T] {
        let gates = self.layout.gates();
        network.back_project(&self.dz[self.row[t] * gates..][..self.alive[t] * gates], &mut self.dx);
        &self.dx
    }

    /// Adds the derivative by the answering states to what the step after gave; a state that no step reads has none.
    fn head_backward(&mut self, weights: &[T], t: usize, dy: &[T], gradient: &mut [T]) {
        let hidden = self.layout.hidden;
        let (from, alive) = (self.row[t], self.alive[t]);
        let read = self.alive.get(t + 1).copied().unwrap_or(0);
        for buffer in [&mut self.dh, &mut self.dc] {
            buffer[read * hidden..alive * hidden].fill(T::zero());
        }
        self.dy[from..from + dy.len()].copy_from_slice(dy);
        let head = &weights[self.layout.head()];
        let (begin, end) = (self.layout.head().start, self.layout.head_bias());
        let states = self.h[from * hidden..][..dy.len() * hidden].chunks_exact(hidden);
        for ((dy, h), dh) in dy.iter().zip(states).zip(self.dh.chunks_exact_mut(hidden)) {
            for (dh, w) in dh.iter_mut().zip(head) {
                *dh += *dy * *w;
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
        let (from, alive) = (self.row[t], self.alive[t]);
        let before = if t > 0 { self.row[t - 1] } else { 0 };
        let z = &self.z[from * gates..][..alive * gates];
        let (c_before, c) = self.c.split_at(from * hidden);
        let Self { dz, dh, dc, dh_before, dc_before, .. } = self;
        let dz = &mut dz[from * gates..][..alive * gates];
        let states = alive * hidden;
        let (c, dh, dc) = (&c[..states], &dh[..states], &dc[..states]);
        if t == 0 {
            dz.fill(T::zero());
            each_unit(FirstBackward { hidden, z, c, dh, dc, sum: dz });
        } else {
            let before = &c_before[before * hidden..][..states];
            let dc_before = &mut dc_before[..states];
            each_unit(LaterBackward { hidden, z, c, before, dh, dc, dz, dc_before, sum: None });
            network.backward.multiply(dz, &mut dh_before[..states]);
        }
    }

    /// The input and recurrent weights' gradients, in as few long products as the events' lengths allow:
    /// `dW_ih += Σ dz xᵀ`, `dW_hh += Σ dz h'ᵀ`, h' being the state before.
    pub fn finish(&mut self, gradient: &mut [T]) {
        let (layout, hidden, gates) = (self.layout, self.layout.hidden, self.layout.gates());
        let all = self.row[self.steps()];
        let dz = |from: usize, count: usize| rows(&self.dz[from * gates..][..count * gates], count, gates);
        let inputs = columns(&self.inputs[..all * layout.inputs], layout.inputs, all);
        product(&mut gradient[layout.input()], 1.0, &inputs, &dz(0, all));
        let recurrent = &mut gradient[layout.recurrent()];
        let mut t = 1;
        while t < self.steps() {
            // Where as many events are alive as before, states and derivatives lie in step.
            let alive = self.alive[t];
            let mut end = t + 1;
            while self.alive[t - 1] == alive && end < self.steps() && self.alive[end] == alive {
                end += 1;
            }
            let count = self.row[end] - self.row[t];
            let states = columns(&self.h[self.row[t - 1] * hidden..][..count * hidden], hidden, count);
            product(recurrent, 1.0, &states, &dz(self.row[t], count));
            t = end;
        }
    }

    /// Overwrites `gradient` with that of event `n` alone, once every step was gone back through. Any number of other events
    /// may have been alive beside it.
    ///
    /// # Panics
    /// When there is no such event.
    pub fn own(&mut self, n: usize, gradient: &mut [T]) {
        let (layout, hidden, gates) = (self.layout, self.layout.hidden, self.layout.gates());
        let (begin, end) = (layout.head().start, layout.head_bias());
        let Own { inputs, dz, h } = &mut self.own;
        for buffer in [&mut *inputs, dz, h] {
            buffer.clear();
        }
        gradient.fill(T::zero());
        for (t, &from) in
            self.row.iter().enumerate().take_while(|&(t, _)| self.alive.get(t).is_some_and(|&alive| n < alive))
        {
            let row = from + n;
            inputs.extend_from_slice(&self.inputs[row * layout.inputs..][..layout.inputs]);
            dz.extend_from_slice(&self.dz[row * gates..][..gates]);
            h.extend_from_slice(&self.h[row * hidden..][..hidden]);
            for (db, dz) in gradient[layout.bias()].iter_mut().zip(&dz[t * gates..]) {
                *db += *dz;
            }
            if t + 1 >= self.horizon {
                for (dw, h) in gradient[begin..end].iter_mut().zip(&h[t * hidden..]) {
                    *dw += self.dy[row] * *h;
                }
                gradient[end] += self.dy[row];
            }
        }
        let steps = dz.len() / gates;
        assert!(steps > 0, "one of the events");
        let by_inputs = columns(inputs, layout.inputs, steps);
        product(&mut gradient[layout.input()], 0.0, &by_inputs, &rows(dz, steps, gates));
        let before = columns(&h[..(steps - 1) * hidden], hidden, steps - 1);
        product(&mut gradient[layout.recurrent()], 0.0, &before, &rows(&dz[gates..], steps - 1, gates));
    }
}
