//! Each window's own gradient, squared or in absolute value, summed over windows: what importance is made of.

use super::{Layout, Real, vectorised, wide_registers};

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

/// Gates whose weights are summed together: each state that is read serves both.
const GATES: usize = 2;
/// Gates of the shared weights that are summed together, with every input and the bias.
const SHARED_LANES: usize = 32;

/// Sums of the magnitudes of own gradients. Recurrent weights have no shortcut through summed products: `(Σ_τ δ_τ h_τᵀ)²`
/// needs each window's own sum. It is held in registers, and so are the sums over windows while a few of these pass.
#[derive(Debug)]
pub(super) struct Squares<T> {
    layout: Layout,
    /// Of the input weights and the bias, (inputs + 1) × gates: transposed, so that gates lie beside each other.
    shared: Vec<T>,
}

/// Some windows' values, step by step, of each step window by window.
struct Tile<'a, T> {
    layout: Layout,
    windows: usize,
    inputs: &'a [T],
    /// Derivatives by the gates' pre-activations.
    dz: &'a [T],
    /// States after each step.
    h: &'a [T],
    magnitude: Magnitude,
}

impl<T: Real> Squares<T> {
    pub(super) fn new(layout: Layout) -> Self {
        Self { layout, shared: Vec::new() }
    }

    /// Adds those of some windows: their inputs, derivatives by the gates' pre-activations and states after each step, all
    /// step-major, and each one's derivative by its head's value.
    pub(super) fn add(&mut self, magnitude: Magnitude, (inputs, dz, h, dy): (&[T], &[T], &[T], &[T]), sums: &mut [T]) {
        let (layout, hidden) = (self.layout, self.layout.hidden);
        let (lstm, head) = sums.split_at_mut(layout.head().start);
        let last = &h[h.len() - dy.len() * hidden..];
        for (dy, h) in dy.iter().zip(last.chunks_exact(hidden)) {
            for (sum, h) in head.iter_mut().zip(h) {
                *sum += magnitude.of(*dy * *h);
            }
            head[hidden] += magnitude.of(*dy);
        }
        let (input, rest) = lstm.split_at_mut(layout.recurrent().start);
        let (recurrent, bias) = rest.split_at_mut(layout.recurrent().len());
        self.shared.clear();
        self.shared.resize((layout.inputs + 1) * layout.gates(), T::zero());
        let tile = Tile { layout, windows: dy.len(), inputs, dz, h, magnitude };
        let shared = &mut self.shared;
        vectorised(
            #[inline(always)]
            || match magnitude {
                Magnitude::Square => Tile { magnitude: Magnitude::Square, ..tile }.add(shared, recurrent),
                Magnitude::Absolute => Tile { magnitude: Magnitude::Absolute, ..tile }.add(shared, recurrent),
            },
        );
        for (gate, (bias, input)) in bias.iter_mut().zip(input.chunks_exact_mut(layout.inputs)).enumerate() {
            let of = |k: usize| self.shared[k * layout.gates() + gate];
            for (k, input) in input.iter_mut().enumerate() {
                *input += of(k);
            }
            *bias += of(layout.inputs);
        }
    }
}

impl<T: Real> Tile<'_, T> {
    #[inline(always)]
    fn add(&self, shared: &mut [T], recurrent: &mut [T]) {
        for (k, shared) in shared.chunks_exact_mut(self.layout.gates()).enumerate() {
            self.add_shared((k < self.layout.inputs).then_some(k), shared);
        }
        if wide_registers() {
            self.add_recurrent::<64>(recurrent);
        } else {
            self.add_recurrent::<16>(recurrent);
        }
    }

    /// The weights of one input, or the bias, of all gates.
    #[inline(always)]
    fn add_shared(&self, input: Option<usize>, sums: &mut [T]) {
        let (inputs, gates) = (self.layout.inputs, self.layout.gates());
        for (block, sums) in sums.chunks_mut(SHARED_LANES).enumerate() {
            for n in 0..self.windows {
                let mut g = [T::zero(); SHARED_LANES];
                let rows = self.dz.chunks_exact(gates).skip(n).step_by(self.windows);
                for (dz, x) in rows.zip(self.inputs.chunks_exact(inputs).skip(n).step_by(self.windows)) {
                    let x = input.map_or(T::one(), |k| x[k]);
                    for (g, dz) in g.iter_mut().zip(&dz[block * SHARED_LANES..]) {
                        *g = dz.fma(x, *g);
                    }
                }
                for (sum, g) in sums.iter_mut().zip(g) {
                    *sum += self.magnitude.of(g);
                }
            }
        }
    }

    /// The recurrent weights: `GATES` gates by `L` units at a time.
    #[inline(always)]
    fn add_recurrent<const L: usize>(&self, sums: &mut [T]) {
        let hidden = self.layout.hidden;
        for (at, sums) in sums.chunks_exact_mut(GATES * hidden).enumerate() {
            let mut units = 0;
            while units + L <= hidden {
                self.add_units::<L>(at * GATES, units, sums);
                units += L;
            }
            while units < hidden {
                self.add_units::<1>(at * GATES, units, sums);
                units += 1;
            }
        }
    }

    #[inline(always)]
    fn add_units<const L: usize>(&self, gate: usize, unit: usize, sums: &mut [T]) {
        let (hidden, gates, windows) = (self.layout.hidden, self.layout.gates(), self.windows);
        let mut total = [[T::zero(); L]; GATES];
        for n in 0..windows {
            let mut g = [[T::zero(); L]; GATES];
            // A step's derivatives meet the state before it.
            for (dz, h) in
                self.dz[windows * gates..].chunks_exact(windows * gates).zip(self.h.chunks_exact(windows * hidden))
            {
                let h: &[T; L] = h[n * hidden + unit..].first_chunk().expect("units lie within their row");
                let dz: &[T; GATES] = dz[n * gates + gate..].first_chunk().expect("gates come in fours");
                for k in 0..GATES {
                    for l in 0..L {
                        g[k][l] = dz[k].fma(h[l], g[k][l]);
                    }
                }
            }
            for k in 0..GATES {
                for l in 0..L {
                    total[k][l] += self.magnitude.of(g[k][l]);
                }
            }
        }
        for k in 0..GATES {
            for (sum, total) in sums[k * hidden + unit..].iter_mut().zip(total[k]) {
                *sum += total;
            }
        }
    }
}
