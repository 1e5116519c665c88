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

impl<T: Real> Overlap<T> {
    /// Adds `Σ_windows |g|` or `Σ_windows g²` to `sums`, g being the gradient of that window's own output (scaled by the `dy`
    /// that [`Overlap::backward`] was given). Call after going back through every step; the windows must have had no
    /// influence on each other, so the inputs must have been data.
    ///
    /// Recurrent weights have no shortcut through summed products: `(Σ_τ δ_τ h_τᵀ)²` needs each window's own sum.
    pub fn add_magnitudes(&self, magnitude: Magnitude, sums: &mut [T]) {
        let horizon = self.plan.horizon();
        let mut window = Window { rows: Vec::with_capacity(horizon), inputs: Vec::with_capacity(horizon) };
        for start in 0..self.plan.steps() {
            for (n, answer) in self.plan.first(start).enumerate() {
                window.trace(self, start, n);
                vectorised(
                    #[inline(always)]
                    || match magnitude {
                        Magnitude::Square => self.add_window(&window, answer, Magnitude::Square, sums),
                        Magnitude::Absolute => self.add_window(&window, answer, Magnitude::Absolute, sums),
                    },
                );
            }
        }
    }

    #[inline(always)]
    fn add_window(&self, window: &Window, answer: usize, magnitude: Magnitude, sums: &mut [T]) {
        let layout = self.layout;
        let hidden = layout.hidden;
        let (lstm, head) = sums.split_at_mut(layout.head().start);
        let dy = self.answer_dy[answer];
        for (sum, h) in head.iter_mut().zip(&self.answer_h[answer * hidden..(answer + 1) * hidden]) {
            *sum += magnitude.of(dy * *h);
        }
        head[hidden] += magnitude.of(dy);
        let (input, rest) = lstm.split_at_mut(layout.recurrent().start);
        let (recurrent, bias) = rest.split_at_mut(layout.recurrent().len());
        for gate in 0..layout.gates() {
            self.add_gate(
                window,
                answer,
                gate,
                magnitude,
                &mut input[gate * INPUTS..][..INPUTS],
                &mut recurrent[gate * hidden..][..hidden],
                &mut bias[gate],
            );
        }
    }

    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "three slices of one vector, cut once by the caller")]
    fn add_gate(
        &self,
        window: &Window,
        answer: usize,
        gate: usize,
        magnitude: Magnitude,
        input: &mut [T],
        recurrent: &mut [T],
        bias: &mut T,
    ) {
        const LANES: usize = 64;
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let delta = |row: usize| self.carried_z[row * gates + gate];
        let x = |step: usize| &self.inputs[window.inputs[step]..][..INPUTS];
        let mut g_bias = self.first_z[answer * gates + gate];
        let mut g_input = [T::zero(); INPUTS];
        for k in 0..INPUTS {
            g_input[k] = g_bias * x(0)[k];
        }
        for (step, &row) in window.rows.iter().enumerate() {
            let d = delta(row);
            g_bias += d;
            for k in 0..INPUTS {
                g_input[k] = d.fma(x(step + 1)[k], g_input[k]);
            }
        }
        *bias += magnitude.of(g_bias);
        for k in 0..INPUTS {
            input[k] += magnitude.of(g_input[k]);
        }
        let mut blocks = recurrent.chunks_exact_mut(LANES);
        let mut from = 0;
        for block in &mut blocks {
            let mut g = [T::zero(); LANES];
            for &row in &window.rows {
                let d = delta(row);
                let h = &self.carried_h[row * hidden + from..][..LANES];
                for lane in 0..LANES {
                    g[lane] = d.fma(h[lane], g[lane]);
                }
            }
            for lane in 0..LANES {
                block[lane] += magnitude.of(g[lane]);
            }
            from += LANES;
        }
        for (at, sum) in (from..).zip(blocks.into_remainder()) {
            let mut g = T::zero();
            for &row in &window.rows {
                g = delta(row).fma(self.carried_h[row * hidden + at], g);
            }
            *sum += magnitude.of(g);
        }
    }

    /// The layout of the weights.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }
}

/// Where one window's later steps lie among the carried rows, and its inputs.
struct Window {
    rows: Vec<usize>,
    inputs: Vec<usize>,
}

impl Window {
    fn trace<T>(&mut self, overlap: &Overlap<T>, start: usize, n: usize) {
        let plan = &overlap.plan;
        self.rows.clear();
        self.inputs.clear();
        self.inputs.push(overlap.input_row[start] + n * INPUTS);
        for slot in 1..plan.horizon() {
            let t = start + slot;
            let rows = plan.slots(t).nth(slot - 1).expect("the window is alive for its whole horizon");
            self.rows.push(plan.carried(t).start + rows.start + n);
            self.inputs.push(overlap.input_row[t] + n * INPUTS);
        }
    }
}
