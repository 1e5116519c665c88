//! Windows on their own, a few at a time: forward, backward, and each one's own gradient squared or in absolute value.

use super::buffer::Aligned;
use super::gates::{First, FirstBackward, Later, LaterBackward};
use super::lanes::each_unit;
use super::squares::{Magnitude, Squares, Values};
use super::{Layout, Network, Real};

/// The passes over windows of recorded inputs, which have no influence on each other: what importance over the open loop takes.
///
/// Windows that are taken at once begin at neighbouring steps: the input of a step is projected once for all that read it.
/// Everything that they leave behind stays in the cache until their gradients are summed.
#[derive(Debug)]
pub struct Windows<T> {
    layout: Layout,
    horizon: usize,
    /// Of each step that some window reads. What follows is step-major: a window's step, then the window.
    inputs: Vec<T>,
    z: Aligned<T>,
    c: Aligned<T>,
    h: Aligned<T>,
    /// Derivatives by the gates' pre-activations.
    dz: Aligned<T>,
    projected: Aligned<T>,
    dh: Aligned<T>,
    dc: Aligned<T>,
    dc_before: Aligned<T>,
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
            z: Aligned::new(),
            c: Aligned::new(),
            h: Aligned::new(),
            dz: Aligned::new(),
            projected: Aligned::new(),
            dh: Aligned::new(),
            dc: Aligned::new(),
            dc_before: Aligned::new(),
            outputs: empty(),
            squares: Squares::new(layout),
        }
    }

    /// The head's value of every window within these steps, of which `inputs` has the standardised ones.
    ///
    /// # Panics
    /// When there are no windows or more than [`Self::AT_ONCE`], or parts of a step.
    pub fn forward(&mut self, network: &Network<T>, inputs: &[T]) -> &[T] {
        let (layout, hidden, gates) = (self.layout, self.layout.hidden, self.layout.gates());
        let steps = inputs.len() / layout.inputs;
        assert!(steps >= self.horizon && inputs.len() == steps * layout.inputs, "at least one whole window");
        let count = steps - self.horizon + 1;
        assert!(count <= Self::AT_ONCE, "a few windows");
        self.inputs.clear();
        self.inputs.extend_from_slice(inputs);
        let rows = self.horizon * count;
        self.projected.grow(steps * gates);
        for (buffer, width) in
            [(&mut self.z, gates), (&mut self.dz, gates), (&mut self.c, hidden), (&mut self.h, hidden)]
        {
            buffer.grow(rows * width);
        }
        network.project(inputs, &mut self.projected[..steps * gates]);
        let Self { z, c, h, projected, .. } = self;
        for step in 0..self.horizon {
            let (before, from) = (step.saturating_sub(1) * count, step * count);
            let (before_c, c) = c.split_at_mut(from * hidden);
            let (before_h, h) = h.split_at_mut(from * hidden);
            let (c, h) = (&mut c[..count * hidden], &mut h[..count * hidden]);
            let (z, p) = (&mut z[from * gates..][..count * gates], &projected[step * gates..][..count * gates]);
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
            buffer.grow(count * hidden);
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
