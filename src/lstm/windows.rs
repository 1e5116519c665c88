//! Windows on their own, a few at a time: forward, backward, and each one's own gradient squared or in absolute value.

use super::buffer::grow;
use super::gates::{First, FirstBackward, Later, LaterBackward};
use super::lanes::each_unit;
use super::squares::{Magnitude, Squares, Values};
use super::{Layout, Network, Real};

/// The passes over windows of given inputs, which have no influence on each other: what importance over the open loop takes.
///
/// Everything that a few windows leave behind stays in the cache until their gradients are summed.
#[derive(Debug)]
pub struct Windows<T> {
    layout: Layout,
    horizon: usize,
    /// Step-major: step, then window.
    inputs: Vec<T>,
    z: Vec<T>,
    c: Vec<T>,
    h: Vec<T>,
    /// Derivatives by the gates' pre-activations.
    dz: Vec<T>,
    projected: Vec<T>,
    dh: Vec<T>,
    dc: Vec<T>,
    dc_before: Vec<T>,
    outputs: Vec<T>,
    squares: Squares<T>,
}

impl<T: Real> Windows<T> {
    /// Most windows taken at once.
    pub const AT_ONCE: usize = 8;

    /// Empty buffers for windows of so many steps.
    #[must_use]
    pub fn new(layout: Layout, horizon: usize) -> Self {
        let empty = Vec::new;
        Self {
            layout,
            horizon,
            inputs: empty(),
            z: empty(),
            c: empty(),
            h: empty(),
            dz: empty(),
            projected: empty(),
            dh: empty(),
            dc: empty(),
            dc_before: empty(),
            outputs: empty(),
            squares: Squares::new(layout),
        }
    }

    /// The head's value for each window; `inputs` are standardised, step by step, of each step window by window.
    ///
    /// # Panics
    /// When there are more than [`Self::AT_ONCE`] windows, or parts of one.
    pub fn forward(&mut self, network: &Network<T>, inputs: &[T]) -> &[T] {
        let (layout, hidden, gates) = (self.layout, self.layout.hidden, self.layout.gates());
        let each = self.horizon * layout.inputs;
        let count = inputs.len() / each;
        assert!(count <= Self::AT_ONCE && inputs.len() == count * each, "a few whole windows");
        self.inputs.clear();
        self.inputs.extend_from_slice(inputs);
        let rows = self.horizon * count;
        for (buffer, width) in [
            (&mut self.z, gates),
            (&mut self.dz, gates),
            (&mut self.projected, gates),
            (&mut self.c, hidden),
            (&mut self.h, hidden),
        ] {
            grow(buffer, rows * width);
        }
        network.project(inputs, &mut self.projected[..rows * gates]);
        let Self { z, c, h, projected, .. } = self;
        for step in 0..self.horizon {
            let (before, from) = (step.saturating_sub(1) * count, step * count);
            let (before_c, c) = c.split_at_mut(from * hidden);
            let (before_h, h) = h.split_at_mut(from * hidden);
            let (c, h) = (&mut c[..count * hidden], &mut h[..count * hidden]);
            let (z, p) = (&mut z[from * gates..][..count * gates], &projected[from * gates..][..count * gates]);
            if step == 0 {
                each_unit(First { hidden, p, z, c, h });
            } else {
                network.forward.multiply(&before_h[before * hidden..], z);
                each_unit(Later { hidden, p, z, before: &before_c[before * hidden..], c, h });
            }
        }
        let last = (self.horizon - 1) * count * hidden;
        network.heads(&self.h[last..][..count * hidden], &mut self.outputs);
        &self.outputs
    }

    /// Adds `Σ_windows |g|` or `Σ_windows g²` to `sums`, g being the gradient of that window's own head value times its `dy`.
    /// After [`Self::forward`] of these windows.
    ///
    /// # Panics
    /// When there is not one `dy` for each of them.
    pub fn add_magnitudes(&mut self, network: &Network<T>, dy: &[T], magnitude: Magnitude, sums: &mut [T]) {
        assert_eq!(dy.len(), self.outputs.len());
        let (layout, hidden, gates) = (self.layout, self.layout.hidden, self.layout.gates());
        let count = dy.len();
        for buffer in [&mut self.dh, &mut self.dc, &mut self.dc_before] {
            grow(buffer, count * hidden);
            buffer[..count * hidden].fill(T::zero());
        }
        let Self { z, dz, c, dh, dc, dc_before, .. } = self;
        let head = &network.weights()[layout.head()];
        for (dy, dh) in dy.iter().zip(dh.chunks_exact_mut(hidden)) {
            for (dh, w) in dh.iter_mut().zip(head) {
                *dh = *dy * *w;
            }
        }
        for step in (0..self.horizon).rev() {
            let (before, from) = (step.saturating_sub(1) * count, step * count);
            let (z, dz) = (&z[from * gates..][..count * gates], &mut dz[from * gates..][..count * gates]);
            let (now, dh) = (&c[from * hidden..][..count * hidden], &mut dh[..count * hidden]);
            if step == 0 {
                dz.fill(T::zero());
                each_unit(FirstBackward { hidden, z, c: now, dh, dc: &dc[..count * hidden], sum: dz });
            } else {
                let before = &c[before * hidden..][..count * hidden];
                each_unit(LaterBackward {
                    hidden,
                    z,
                    c: now,
                    before,
                    dh,
                    dc: &dc[..count * hidden],
                    dz,
                    dc_before,
                    sum: None,
                });
                network.backward.multiply(dz, dh);
                std::mem::swap(dc, dc_before);
            }
        }
        let rows = self.horizon * count;
        let (dz, h) = (&self.dz[..rows * gates], &self.h[..rows * hidden]);
        self.squares.add(magnitude, Values { inputs: &self.inputs, dz, h, dy }, sums);
    }
}
