//! Forward only, for serving: windows one by one or thousands together, the same bits either way.

use super::{Layout, Real, gates, vectorised};

/// Rows that share each load of a weight.
const ROWS: usize = 4;
/// Outputs summed in registers.
const LANES: usize = 64;
/// Windows whose activations stay in the cache together.
const TILE: usize = 32;

/// Fixed weights, arranged for serving.
///
/// Every sum runs over the hidden units in one order whatever the number of windows, so a window's answer does not depend on
/// who shares its batch.
#[derive(Debug, Clone)]
pub struct Encoder<T> {
    layout: Layout,
    weights: Vec<T>,
    /// The recurrent weights transposed: hidden × 4·hidden, row-major.
    by_unit: Vec<T>,
}

impl<T: Real> Encoder<T> {
    /// Arranges `weights`; `None` when their number does not fit the layout.
    #[must_use]
    pub fn new(layout: Layout, weights: Vec<T>) -> Option<Self> {
        if weights.len() != layout.len() {
            return None;
        }
        let (hidden, gates) = (layout.hidden, layout.gates());
        let recurrent = &weights[layout.recurrent()];
        let by_unit = (0..hidden * gates).map(|at| recurrent[(at % gates) * hidden + at / gates]).collect();
        Some(Self { layout, weights, by_unit })
    }

    /// Its layout.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The flat vector.
    #[must_use]
    pub fn weights(&self) -> &[T] {
        &self.weights
    }

    /// The head's value for each window; `inputs` are standardised, windows × `horizon` × inputs.
    ///
    /// # Panics
    /// When the number of inputs does not fit.
    #[must_use]
    pub fn head_values(&self, horizon: usize, inputs: &[T]) -> Vec<T> {
        let window = horizon * self.layout.inputs;
        assert!(inputs.len().is_multiple_of(window), "whole windows");
        let mut values = Vec::with_capacity(inputs.len() / window);
        let mut tile = Tile::new(self.layout, (inputs.len() / window).min(TILE));
        for inputs in inputs.chunks(TILE * window) {
            vectorised(
                #[inline(always)]
                || self.encode_tile(&mut tile, window, inputs),
            );
            let states = tile.h.chunks_exact(self.layout.hidden).take(inputs.len() / window);
            let bias = self.weights[self.layout.head_bias()];
            values.extend(states.map(|h| dot(&self.weights[self.layout.head()], h) + bias));
        }
        values
    }

    /// Advances one vehicle's state by the standardised inputs of one step; the head's value then.
    ///
    /// The same bits as [`Self::head_values`] of a window that began when the state did.
    ///
    /// # Panics
    /// When the number of inputs does not fit.
    pub fn advance(&self, state: &mut EncoderState<T>, inputs: &[T]) -> T {
        assert_eq!(inputs.len(), self.layout.inputs);
        let Tile { z, projected, h, c, before } = &mut state.tile;
        vectorised(
            #[inline(always)]
            || {
                self.project(inputs, projected);
                if state.begun {
                    self.recurrent(h, z);
                    before.copy_from_slice(c);
                    gates::later(z, projected, before, c, h);
                } else {
                    gates::first(z, projected, c, h);
                }
            },
        );
        state.begun = true;
        dot(&self.weights[self.layout.head()], h) + self.weights[self.layout.head_bias()]
    }

    /// The zero state.
    #[must_use]
    pub fn state(&self) -> EncoderState<T> {
        EncoderState { tile: Tile::new(self.layout, 1), begun: false }
    }

    #[inline(always)]
    fn encode_tile(&self, tile: &mut Tile<T>, window: usize, inputs: &[T]) {
        let (hidden, gates, each) = (self.layout.hidden, self.layout.gates(), self.layout.inputs);
        let windows = inputs.len() / window;
        let Tile { z, projected, h, c, before } = tile;
        for step in 0..window / each {
            if step > 0 {
                self.recurrent(&h[..windows * hidden], &mut z[..windows * gates]);
                before.copy_from_slice(c);
            }
            for n in 0..windows {
                let x = &inputs[n * window + step * each..][..each];
                self.project(x, projected);
                let at = n * hidden..(n + 1) * hidden;
                let (z, c, h) = (&mut z[n * gates..(n + 1) * gates], &mut c[at.clone()], &mut h[at.clone()]);
                if step == 0 {
                    gates::first(z, projected, c, h);
                } else {
                    gates::later(z, projected, &before[at], c, h);
                }
            }
        }
    }

    #[inline(always)]
    fn project(&self, x: &[T], projected: &mut [T]) {
        let (input, bias) = (&self.weights[self.layout.input()], &self.weights[self.layout.bias()]);
        for ((p, w), b) in projected.iter_mut().zip(input.chunks_exact(self.layout.inputs)).zip(bias) {
            *p = w.iter().zip(x).fold(*b, |sum, (w, x)| w.fma(*x, sum));
        }
    }

    /// `z = W_hh h` for each row.
    #[inline(always)]
    fn recurrent(&self, h: &[T], z: &mut [T]) {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let blocks = h.len() / (ROWS * hidden) * ROWS;
        let (h_blocks, h_rest) = h.split_at(blocks * hidden);
        let (z_blocks, z_rest) = z.split_at_mut(blocks * gates);
        for (h, z) in h_blocks.chunks_exact(ROWS * hidden).zip(z_blocks.chunks_exact_mut(ROWS * gates)) {
            self.recurrent_rows::<ROWS>(h, z);
        }
        for (h, z) in h_rest.chunks_exact(hidden).zip(z_rest.chunks_exact_mut(gates)) {
            self.recurrent_rows::<1>(h, z);
        }
    }

    #[inline(always)]
    fn recurrent_rows<const N: usize>(&self, h: &[T], z: &mut [T]) {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        let whole = gates / LANES * LANES;
        for from in (0..whole).step_by(LANES) {
            let mut sums = [[T::zero(); LANES]; N];
            for unit in 0..hidden {
                let w: &[T] = &self.by_unit[unit * gates + from..][..LANES];
                for n in 0..N {
                    let h = h[n * hidden + unit];
                    for lane in 0..LANES {
                        sums[n][lane] = h.fma(w[lane], sums[n][lane]);
                    }
                }
            }
            for n in 0..N {
                z[n * gates + from..][..LANES].copy_from_slice(&sums[n]);
            }
        }
        for gate in whole..gates {
            for n in 0..N {
                let mut sum = T::zero();
                for unit in 0..hidden {
                    sum = h[n * hidden + unit].fma(self.by_unit[unit * gates + gate], sum);
                }
                z[n * gates + gate] = sum;
            }
        }
    }
}

/// The state of one vehicle that is encoded step by step.
#[derive(Debug)]
pub struct EncoderState<T> {
    tile: Tile<T>,
    begun: bool,
}

/// Activations of some windows.
#[derive(Debug)]
struct Tile<T> {
    z: Vec<T>,
    projected: Vec<T>,
    h: Vec<T>,
    c: Vec<T>,
    before: Vec<T>,
}

impl<T: Real> Tile<T> {
    fn new(layout: Layout, windows: usize) -> Self {
        let zeros = |len| vec![T::zero(); len];
        let (hidden, gates) = (layout.hidden, layout.gates());
        Self {
            z: zeros(windows * gates),
            projected: zeros(gates),
            h: zeros(windows * hidden),
            c: zeros(windows * hidden),
            before: zeros(windows * hidden),
        }
    }
}

/// `Σ a·b` in one fixed order: sixteen interleaved sums, then one after another.
pub(super) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::zero(); 16];
    for (a, b) in a.chunks(16).zip(b.chunks(16)) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += *a * *b;
        }
    }
    sums.into_iter().fold(T::zero(), |total, sum| total + sum)
}
