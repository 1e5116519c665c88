//! Each window's own gradient, squared or in absolute value, summed over windows: what importance is made of.

use super::gradient::Gradient;
use super::lanes::{Kernel, Lanes, Single};
use super::lines::{GATES, LINE, Line};
use super::tiles::{OUTPUTS, TOGETHER, Tiles, add_outer, each_tile, place};
use super::{INPUTS, Real};

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

/// The values of some windows that begin at neighbouring steps, all of which have the same number of steps. Lines are those of
/// one step after another.
#[derive(Debug, Clone, Copy)]
pub(super) struct Values<'a, T> {
    /// Of each step that some window reads.
    pub(super) inputs: &'a [T],
    /// Derivatives by the gates' pre-activations.
    pub(super) dz: &'a [Line<T>],
    /// States after each step.
    pub(super) h: &'a [Line<T>],
    /// Derivatives by each window's head value.
    pub(super) dy: &'a [T],
    /// Steps of a window.
    pub(super) steps: usize,
}

/// Adds the magnitudes of some windows' own gradients to `sums`.
pub(super) fn add_magnitudes<T: Real>(magnitude: Magnitude, values: Values<'_, T>, sums: &mut Gradient<T>) {
    T::run(Recurrent { lines: sums.head.len(), magnitude, values, sums: &mut sums.recurrent });
    T::run(Input { magnitude, values, sums: &mut sums.input });
    let windows = values.dy.len();
    let last = &values.h[(values.steps - 1) * windows * sums.head.len()..];
    for (h, sums) in last.chunks_exact(windows).zip(&mut sums.head) {
        for (dy, h) in values.dy.iter().zip(h) {
            for (sum, h) in sums.0.iter_mut().zip(h.0) {
                *sum = magnitude.add(Single::new(), *dy * h, *sum);
            }
        }
    }
    for dy in values.dy {
        sums.head_bias = magnitude.add(Single::new(), *dy, sums.head_bias);
    }
}

/// The recurrent weights. They have no shortcut through summed products: `(Σ_τ δ_τ h_τᵀ)²` needs each window's own sum, which
/// is held in registers.
struct Recurrent<'a, T> {
    /// Lines of units.
    lines: usize,
    magnitude: Magnitude,
    values: Values<'a, T>,
    /// In the order of [`place`].
    sums: &'a mut [Line<T>],
}

impl<T: Real> Kernel<T> for Recurrent<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(mut self, l: L) {
        each_tile(l, GATES * self.lines * LINE, self.lines, &mut self);
    }
}

impl<T: Real> Tiles<T> for Recurrent<'_, T> {
    /// The sums stay near while the windows pass.
    #[inline(always)]
    fn tile<L: Lanes<Number = T>, const G: usize>(
        &mut self,
        l: L,
        (output, from): (usize, usize),
        (at, lane): (usize, usize),
    ) {
        let windows = self.values.dy.len();
        let gates = GATES * self.lines;
        let sums = &mut self.sums[place(gates * LINE, output * LINE + from, at)..];
        for window in 0..windows {
            let mut g = [[l.splat(T::zero()); G]; OUTPUTS];
            // A step's derivatives meet the state before it.
            for step in 1..self.values.steps {
                let dz = &self.values.dz[(step * gates + output) * windows + window];
                let dz: &[T; OUTPUTS] = dz.0[from..].first_chunk().expect("a line has as many");
                let h = &self.values.h[((step - 1) * self.lines + at) * windows + window..];
                let h: [L::Value; G] = std::array::from_fn(
                    #[inline(always)]
                    |g| l.load(&h[g * windows].0[lane..]),
                );
                add_outer(l, dz, h, &mut g);
            }
            for n in 0..OUTPUTS {
                for k in 0..G {
                    let sum = &mut sums[n * TOGETHER + k].0[lane..];
                    l.store(sum, self.magnitude.add(l, g[n][k], l.load(sum)));
                }
            }
        }
    }
}

/// The input weights and the bias.
struct Input<'a, T> {
    magnitude: Magnitude,
    values: Values<'a, T>,
    /// Input by input, the weights of all pre-activations, then the bias.
    sums: &'a mut [Line<T>],
}

impl<T: Real> Kernel<T> for Input<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, l: L) {
        let Self { magnitude, values, sums } = self;
        let (windows, gates) = (values.dy.len(), sums.len() / (INPUTS + 1));
        let (inputs, _) = values.inputs.as_chunks::<INPUTS>();
        for output in 0..gates {
            for lane in (0..LINE).step_by(L::WIDTH) {
                for window in 0..windows {
                    let mut g = [l.splat(T::zero()); INPUTS + 1];
                    for step in 0..values.steps {
                        let dz = l.load(&values.dz[(step * gates + output) * windows + window].0[lane..]);
                        for k in 0..INPUTS {
                            g[k] = l.fma(dz, l.splat(inputs[step + window][k]), g[k]);
                        }
                        g[INPUTS] = l.add(g[INPUTS], dz);
                    }
                    for k in 0..=INPUTS {
                        let sum = &mut sums[k * gates + output].0[lane..];
                        l.store(sum, magnitude.add(l, g[k], l.load(sum)));
                    }
                }
            }
        }
    }
}
