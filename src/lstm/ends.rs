//! What lies before the recurrent part of a step and behind it: input weights and head, forward and backward.

use super::Real;
use super::lanes::{Kernel, Lanes};
use super::lines::{LINE, Line, Lines};

/// `W_ih x + b` of each event, in lines of them.
#[derive(Debug)]
pub(super) struct Project<'a, T> {
    /// Input by input, the weights of all pre-activations.
    pub(super) weights: &'a [Line<T>],
    pub(super) bias: &'a [Line<T>],
    /// Event by event.
    pub(super) inputs: &'a [T],
    pub(super) projected: &'a mut [Line<T>],
}

impl<T: Real> Kernel<T> for Project<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, l: L) {
        let outputs = self.bias.len();
        let each = self.weights.len() / outputs;
        let events = self.inputs.len() / each;
        for (output, projected) in self.projected.chunks_exact_mut(events.max(1)).enumerate() {
            for (x, projected) in self.inputs.chunks_exact(each).zip(projected) {
                for at in (0..LINE).step_by(L::WIDTH) {
                    let mut sum = l.load(&self.bias[output].0[at..]);
                    for (k, x) in x.iter().enumerate() {
                        sum = l.fma(l.load(&self.weights[k * outputs + output].0[at..]), l.splat(*x), sum);
                    }
                    l.store(&mut projected.0[at..], sum);
                }
            }
        }
    }
}

/// `dW_ih += Σ dz xᵀ` and `db += Σ dz`, over events.
#[derive(Debug)]
pub(super) struct ProjectBackward<'a, T> {
    /// Event by event.
    pub(super) inputs: &'a [T],
    /// By the pre-activations of each event.
    pub(super) dz: Lines<'a, T>,
    /// As the weights of [`Project`], then the bias.
    pub(super) sums: &'a mut [Line<T>],
    /// Lines of pre-activations.
    pub(super) outputs: usize,
}

impl<T: Real> Kernel<T> for ProjectBackward<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, l: L) {
        let (weights, bias) = self.sums.split_at_mut(self.sums.len() - self.outputs);
        let each = weights.len() / self.outputs;
        for output in 0..self.outputs {
            let dz = self.dz.line(output);
            for at in (0..LINE).step_by(L::WIDTH) {
                for k in 0..each {
                    let place = &mut weights[k * self.outputs + output].0[at..];
                    let mut sum = l.load(place);
                    for (dz, x) in dz.iter().zip(self.inputs.chunks_exact(each)) {
                        sum = l.fma(l.load(&dz.0[at..]), l.splat(x[k]), sum);
                    }
                    l.store(place, sum);
                }
                let place = &mut bias[output].0[at..];
                let mut sum = l.load(place);
                for dz in dz {
                    sum = l.add(sum, l.load(&dz.0[at..]));
                }
                l.store(place, sum);
            }
        }
    }
}

/// Sums of products along lines: each lane along the lines, then one lane after another.
#[derive(Debug)]
pub(super) struct Dots<'a, T> {
    /// A number of vectors, each as long as the rows.
    pub(super) vectors: &'a [Line<T>],
    /// Lines of each.
    pub(super) lines: usize,
    pub(super) rows: Lines<'a, T>,
    /// The first row that counts.
    pub(super) first: usize,
    /// Takes, row by row, the product with each vector.
    pub(super) out: &'a mut [T],
}

impl<T: Real> Kernel<T> for Dots<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, l: L) {
        let vectors = self.vectors.chunks_exact(self.lines);
        for (row, out) in self.out.chunks_exact_mut(vectors.len()).enumerate() {
            for (vector, out) in vectors.clone().zip(out) {
                let mut sums = Line::zero();
                for at in (0..LINE).step_by(L::WIDTH) {
                    let mut sum = l.splat(T::zero());
                    for (line, v) in vector.iter().enumerate() {
                        let x = l.load(&self.rows.line(line)[self.first + row].0[at..]);
                        sum = l.add(sum, l.mul(l.load(&v.0[at..]), x));
                    }
                    l.store(&mut sums.0[at..], sum);
                }
                *out = sums.0.into_iter().fold(T::zero(), |total, sum| total + sum);
            }
        }
    }
}

/// From the derivative by each answer to those by the states that gave it, and by the head's weights.
#[derive(Debug)]
pub(super) struct HeadBackward<'a, T> {
    pub(super) head: &'a [Line<T>],
    pub(super) h: Lines<'a, T>,
    /// The first row that answers.
    pub(super) first: usize,
    pub(super) dy: &'a [T],
    /// Of each line, the derivatives of all rows: added to.
    pub(super) dh: &'a mut [Line<T>],
    pub(super) sums: &'a mut [Line<T>],
}

impl<T: Real> Kernel<T> for HeadBackward<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, l: L) {
        let rows = self.dh.len() / self.head.len();
        for (line, dh) in self.dh.chunks_exact_mut(rows).enumerate() {
            let (h, dh) = (&self.h.line(line)[self.first..], &mut dh[self.first..]);
            for at in (0..LINE).step_by(L::WIDTH) {
                let w = l.load(&self.head[line].0[at..]);
                let mut sum = l.load(&self.sums[line].0[at..]);
                for ((h, dh), dy) in h.iter().zip(&mut *dh).zip(self.dy) {
                    let (dy, dh) = (l.splat(*dy), &mut dh.0[at..]);
                    sum = l.fma(dy, l.load(&h.0[at..]), sum);
                    l.store(dh, l.fma(dy, w, l.load(dh)));
                }
                l.store(&mut self.sums[line].0[at..], sum);
            }
        }
    }
}
