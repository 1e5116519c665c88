//! Each window's own gradient, squared or in absolute value, summed over windows: what importance is made of.

use super::{INPUTS, Layout, Overlap, Real, vectorised};

/// What is summed of each window's gradient g.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Magnitude {
    /// g².
    Square,
    /// |g|.
    Absolute,
}

impl Magnitude {
    #[inline(always)]
    fn of<T: Real>(self, g: T) -> T {
        match self {
            Self::Square => g * g,
            Self::Absolute => g.abs(),
        }
    }
}

/// Outputs summed in registers.
const LANES: usize = 64;

impl<T: Real> Overlap<T> {
    /// Adds `Σ_windows |g|` or `Σ_windows g²` to `sums`, g being the gradient of that window's own output (scaled by the `dy`
    /// that [`Overlap::backward`] was given). Call after going back through every step; the windows must have had no
    /// influence on each other, so the inputs must have been data.
    ///
    /// Recurrent weights have no shortcut through summed products: `(Σ_τ δ_τ h_τᵀ)²` needs each window's own sum.
    pub fn add_magnitudes(&self, magnitude: Magnitude, sums: &mut [T]) {
        let empty = Vec::new;
        let mut window = Window { deltas: empty(), states: empty(), inputs: empty(), answer: empty(), dy: T::zero() };
        for start in 0..self.plan.steps() {
            for (n, answer) in self.plan.first(start).enumerate() {
                self.gather(&mut window, start, n, answer);
                vectorised(
                    #[inline(always)]
                    || match magnitude {
                        Magnitude::Square => window.add(self.layout, Magnitude::Square, sums),
                        Magnitude::Absolute => window.add(self.layout, Magnitude::Absolute, sums),
                    },
                );
            }
        }
    }

    /// Copies one window's values next to each other, so that its sums read a few kilobytes of cache.
    fn gather(&self, window: &mut Window<T>, start: usize, n: usize, answer: usize) {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        window.deltas.clear();
        window.states.clear();
        window.inputs.clear();
        window.deltas.extend_from_slice(&self.first_z[answer * gates..(answer + 1) * gates]);
        window.inputs.extend_from_slice(&self.inputs[self.input_row[start] + n * INPUTS..][..INPUTS]);
        for slot in 1..self.plan.horizon() {
            let t = start + slot;
            let rows = self.plan.slots(t).nth(slot - 1).expect("the window is alive for its whole horizon");
            let row = self.plan.carried(t).start + rows.start + n;
            window.deltas.extend_from_slice(&self.carried_z[row * gates..(row + 1) * gates]);
            window.states.extend_from_slice(&self.carried_h[row * hidden..(row + 1) * hidden]);
            window.inputs.extend_from_slice(&self.inputs[self.input_row[t] + n * INPUTS..][..INPUTS]);
        }
        window.answer.clear();
        window.answer.extend_from_slice(&self.answer_h[answer * hidden..(answer + 1) * hidden]);
        window.dy = self.answer_dy[answer];
    }

    /// The layout of the weights.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }
}

/// One window's derivatives and what they multiply, step by step.
struct Window<T> {
    /// By the gates' pre-activations, horizon × 4·hidden.
    deltas: Vec<T>,
    /// The states before each step but the first, (horizon − 1) × hidden.
    states: Vec<T>,
    /// horizon × 4.
    inputs: Vec<T>,
    /// The last state.
    answer: Vec<T>,
    /// By the head's value.
    dy: T,
}

impl<T: Real> Window<T> {
    #[inline(always)]
    fn add(&self, layout: Layout, magnitude: Magnitude, sums: &mut [T]) {
        let hidden = layout.hidden;
        let (lstm, head) = sums.split_at_mut(layout.head().start);
        for (sum, h) in head.iter_mut().zip(&self.answer) {
            *sum += magnitude.of(self.dy * *h);
        }
        head[hidden] += magnitude.of(self.dy);
        let (input, rest) = lstm.split_at_mut(layout.recurrent().start);
        let (recurrent, bias) = rest.split_at_mut(layout.recurrent().len());
        self.add_shared(magnitude, input, bias);
        for (gate, sums) in recurrent.chunks_exact_mut(hidden).enumerate() {
            self.add_recurrent(gate, magnitude, sums);
        }
    }

    /// Input weights and bias.
    #[inline(always)]
    fn add_shared(&self, magnitude: Magnitude, input: &mut [T], bias: &mut [T]) {
        let gates = bias.len();
        for (gate, (bias, input)) in bias.iter_mut().zip(input.as_chunks_mut::<INPUTS>().0).enumerate() {
            let (mut g_bias, mut g_input) = (T::zero(), [T::zero(); INPUTS]);
            for (x, deltas) in self.inputs.as_chunks::<INPUTS>().0.iter().zip(self.deltas.chunks_exact(gates)) {
                g_bias += deltas[gate];
                for k in 0..INPUTS {
                    g_input[k] = deltas[gate].fma(x[k], g_input[k]);
                }
            }
            *bias += magnitude.of(g_bias);
            for k in 0..INPUTS {
                input[k] += magnitude.of(g_input[k]);
            }
        }
    }

    /// One gate's recurrent weights.
    #[inline(always)]
    fn add_recurrent(&self, gate: usize, magnitude: Magnitude, sums: &mut [T]) {
        let hidden = sums.len();
        let later = || self.deltas.chunks_exact(4 * hidden).skip(1).map(|deltas| deltas[gate]);
        let (blocks, rest) = sums.as_chunks_mut::<LANES>();
        for (block, sums) in blocks.iter_mut().enumerate() {
            let mut g = [T::zero(); LANES];
            for (states, d) in self.states.chunks_exact(hidden).zip(later()) {
                let states: &[T; LANES] = states[block * LANES..].first_chunk().expect("a block lies within its row");
                for lane in 0..LANES {
                    g[lane] = d.fma(states[lane], g[lane]);
                }
            }
            for lane in 0..LANES {
                sums[lane] += magnitude.of(g[lane]);
            }
        }
        let from = hidden - rest.len();
        for (sum, at) in rest.iter_mut().zip(from..) {
            let each = self.states.chunks_exact(hidden).zip(later());
            let g = each.fold(T::zero(), |g, (states, d)| d.fma(states[at], g));
            *sum += magnitude.of(g);
        }
    }
}
