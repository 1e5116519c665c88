//! Each window's own gradient, squared or in absolute value, summed over windows: what importance is made of.

use super::lanes::{Kernel, Lanes, Single, Units, each_unit};
use super::{INPUTS, Layout, Real};

/// What is summed of each window's gradient g.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Magnitude {
    /// g².
    Square,
    /// |g|.
    Absolute,
}

impl Magnitude {
    /// With another one in the sum.
    #[inline(always)]
    fn add<L: Lanes>(self, l: L, g: L::Value, sum: L::Value) -> L::Value {
        match self {
            Self::Square => l.fma(g, g, sum),
            Self::Absolute => l.add(l.abs(g), sum),
        }
    }
}

/// Gates whose weights are summed together: each state that is read serves all of them.
const GATES: usize = 4;

/// Sums of the magnitudes of own gradients. Recurrent weights have no shortcut through summed products: `(Σ_τ δ_τ h_τᵀ)²`
/// needs each window's own sum, which is held in registers.
#[derive(Debug)]
pub(super) struct Squares<T> {
    layout: Layout,
    /// Of the input weights and the bias, (inputs + 1) × gates: transposed, so that gates lie beside each other.
    shared: Vec<T>,
}

/// The values of some windows that begin at neighbouring steps; step by step, of each step window by window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Values<'a, T> {
    /// Of each step that some window reads.
    pub(super) inputs: &'a [T],
    /// Derivatives by the gates' pre-activations.
    pub(super) dz: &'a [T],
    /// States after each step.
    pub(super) h: &'a [T],
    /// Derivatives by each window's head value.
    pub(super) dy: &'a [T],
}

impl<T: Real> Squares<T> {
    /// For networks that read the paper's inputs.
    pub(super) fn new(layout: Layout) -> Self {
        assert_eq!(layout.inputs, INPUTS, "windows read the paper's four inputs");
        Self { layout, shared: Vec::new() }
    }

    /// Adds those of some windows to `sums`.
    pub(super) fn add(&mut self, magnitude: Magnitude, values: Values<'_, T>, sums: &mut [T]) {
        let (layout, hidden) = (self.layout, self.layout.hidden);
        let (lstm, head) = sums.split_at_mut(layout.head().start);
        let last = &values.h[values.h.len() - values.dy.len() * hidden..];
        for (dy, h) in values.dy.iter().zip(last.chunks_exact(hidden)) {
            for (sum, h) in head.iter_mut().zip(h) {
                *sum = magnitude.add(Single::new(), *dy * *h, *sum);
            }
            head[hidden] = magnitude.add(Single::new(), *dy, head[hidden]);
        }
        let (input, rest) = lstm.split_at_mut(layout.recurrent().start);
        let (recurrent, bias) = rest.split_at_mut(layout.recurrent().len());
        self.shared.clear();
        self.shared.resize((INPUTS + 1) * layout.gates(), T::zero());
        each_unit(Shared { layout, values, magnitude, sums: &mut self.shared });
        T::run(Recurrent { layout, values, magnitude, sums: recurrent });
        let of = |k: usize, gate: usize| self.shared[k * layout.gates() + gate];
        for (gate, (bias, input)) in bias.iter_mut().zip(input.as_chunks_mut::<INPUTS>().0).enumerate() {
            for (k, input) in input.iter_mut().enumerate() {
                *input += of(k, gate);
            }
            *bias += of(INPUTS, gate);
        }
    }
}

/// The input weights and the bias.
struct Shared<'a, T> {
    layout: Layout,
    values: Values<'a, T>,
    magnitude: Magnitude,
    sums: &'a mut [T],
}

impl<T: Real> Units<T> for Shared<'_, T> {
    #[inline(always)]
    fn size(&self) -> (usize, usize) {
        (self.values.dy.len(), self.layout.gates())
    }

    #[inline(always)]
    fn unit<L: Lanes<Number = T>>(&mut self, l: L, window: usize, gate: usize) {
        let (gates, windows) = (self.layout.gates(), self.values.dy.len());
        let mut g = [l.splat(T::zero()); INPUTS + 1];
        let steps = self.values.dz.chunks_exact(windows * gates);
        for (dz, x) in steps.zip(&self.values.inputs.as_chunks::<INPUTS>().0[window..]) {
            let dz = l.load(&dz[window * gates + gate..]);
            for k in 0..INPUTS {
                g[k] = l.fma(dz, l.splat(x[k]), g[k]);
            }
            g[INPUTS] = l.add(g[INPUTS], dz);
        }
        for k in 0..=INPUTS {
            let sums = &mut self.sums[k * gates + gate..];
            let sum = self.magnitude.add(l, g[k], l.load(sums));
            l.store(sums, sum);
        }
    }
}

/// The recurrent weights, [`GATES`] gates at a time.
struct Recurrent<'a, T> {
    layout: Layout,
    values: Values<'a, T>,
    magnitude: Magnitude,
    sums: &'a mut [T],
}

impl<T: Real> Kernel<T> for Recurrent<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(mut self, lanes: L) {
        for gate in (0..self.layout.gates()).step_by(GATES) {
            match L::SUMS {
                16 => self.gates::<L, 4>(lanes, gate),
                _ => self.gates::<L, 2>(lanes, gate),
            }
        }
    }
}

impl<T: Real> Recurrent<'_, T> {
    /// All units of some gates, `V` vectors at a time, then one number at a time.
    #[inline(always)]
    fn gates<L: Lanes<Number = T>, const V: usize>(&mut self, lanes: L, gate: usize) {
        let (hidden, width) = (self.layout.hidden, V * L::WIDTH);
        let whole = hidden / width * width;
        for unit in (0..whole).step_by(width) {
            self.units::<L, V>(lanes, gate, unit);
        }
        for unit in whole..hidden {
            self.units::<Single<T>, 1>(Single::new(), gate, unit);
        }
    }

    /// Over all windows, their sums and one window's gradient in registers.
    #[inline(always)]
    fn units<L: Lanes<Number = T>, const V: usize>(&mut self, l: L, gate: usize, unit: usize) {
        let (hidden, gates, windows) = (self.layout.hidden, self.layout.gates(), self.values.dy.len());
        let mut sums: [[L::Value; V]; GATES] = std::array::from_fn(
            #[inline(always)]
            |k| vectors(l, &self.sums[(gate + k) * hidden + unit..]),
        );
        for window in 0..windows {
            let mut g = [[l.splat(T::zero()); V]; GATES];
            // A step's derivatives meet the state before it.
            let later = self.values.dz[windows * gates..].chunks_exact(windows * gates);
            for (dz, h) in later.zip(self.values.h.chunks_exact(windows * hidden)) {
                let h: [L::Value; V] = vectors(l, &h[window * hidden + unit..]);
                let dz: &[T; GATES] = dz[window * gates + gate..].first_chunk().expect("gates come in fours");
                for k in 0..GATES {
                    let dz = l.splat(dz[k]);
                    for v in 0..V {
                        g[k][v] = l.fma(dz, h[v], g[k][v]);
                    }
                }
            }
            for k in 0..GATES {
                for v in 0..V {
                    sums[k][v] = self.magnitude.add(l, g[k][v], sums[k][v]);
                }
            }
        }
        for k in 0..GATES {
            for v in 0..V {
                l.store(&mut self.sums[(gate + k) * hidden + unit + v * L::WIDTH..], sums[k][v]);
            }
        }
    }
}

#[inline(always)]
fn vectors<L: Lanes, const V: usize>(l: L, from: &[L::Number]) -> [L::Value; V] {
    let from = &from[..V * L::WIDTH];
    std::array::from_fn(
        #[inline(always)]
        |v| l.load(&from[v * L::WIDTH..]),
    )
}
