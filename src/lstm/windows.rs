//! Windows on their own, a few at a time: forward, backward, and each one's own gradient squared or in absolute value.

use super::gradient::Gradient;
use super::lines::{Line, Lines, grow};
use super::passes::{Gradients, Passes};
use super::squares::{Magnitude, Values, add_magnitudes};
use super::{INPUTS, Layout, Network, Real};

/// The passes over windows of recorded inputs, which have no influence on each other: what importance over the open loop takes.
///
/// Windows that are taken at once begin at neighbouring steps: the input of a step is projected once for all that read it.
/// Everything that they leave behind stays in the cache until their gradients are summed.
#[derive(Debug)]
pub struct Windows<T> {
    layout: Layout,
    horizon: usize,
    /// Each window is to them a short event with one state.
    passes: Passes<T>,
    /// Of each step that some window reads.
    inputs: Vec<T>,
    projected: Vec<Line<T>>,
    sums: Gradient<T>,
}

/// Most windows taken at once.
const AT_ONCE: usize = 12;

impl<T: Real> Windows<T> {
    /// Most windows taken at once.
    pub const AT_ONCE: usize = AT_ONCE;

    /// Empty buffers for windows of so many steps.
    ///
    /// # Panics
    /// When a window has no steps, or reads more of them than the paper's four inputs: what else it could be told depends on where
    /// it starts.
    #[must_use]
    pub fn new(layout: Layout, horizon: usize) -> Self {
        assert!(horizon > 0 && layout.inputs == INPUTS, "windows read the paper's four inputs");
        Self {
            layout,
            horizon,
            passes: Passes::carried(layout),
            inputs: Vec::new(),
            projected: Vec::new(),
            sums: Gradient::new(layout),
        }
    }

    /// The head's value of every window within these steps, of which `inputs` has the standardised ones.
    ///
    /// # Panics
    /// When there are no windows or more than [`Self::AT_ONCE`], or parts of a step.
    pub fn forward(&mut self, network: &Network<T>, inputs: &[T]) -> &[T] {
        let each = self.layout.inputs;
        let steps = inputs.len() / each;
        assert!(steps >= self.horizon && inputs.len() == steps * each, "at least one whole window");
        let windows = steps - self.horizon + 1;
        assert!(windows <= Self::AT_ONCE, "a few windows");
        self.inputs.clear();
        self.inputs.extend_from_slice(inputs);
        self.passes.begin(self.horizon, &[self.horizon; AT_ONCE][..windows]);
        let lines = steps * network.bias.len();
        grow(&mut self.projected, lines);
        network.project(inputs, &mut self.projected[..lines]);
        let projected = Lines::new(&self.projected[..lines], steps);
        for step in 0..self.horizon - 1 {
            self.passes.advance(network, step, projected, step);
        }
        self.passes.advance(network, self.horizon - 1, projected, self.horizon - 1)
    }

    /// Sums `|g|` or `g²` over windows, g being the gradient of that window's own head value times its `dy`. After
    /// [`Self::forward`] of these windows.
    ///
    /// # Panics
    /// When there is not one `dy` for each of them.
    pub fn add_magnitudes(&mut self, network: &Network<T>, dy: &[T], magnitude: Magnitude) {
        self.passes.turn(Gradients::Own);
        for step in (0..self.horizon).rev() {
            self.passes.backward(network, step, if step + 1 == self.horizon { dy } else { &[] });
        }
        let (dz, h) = self.passes.kept();
        let values = Values { inputs: &self.inputs, dz, h, dy, steps: self.horizon };
        add_magnitudes(magnitude, values, &mut self.sums);
    }

    /// Adds the sums to those of others, in the order of the flat vector, and begins anew.
    pub fn finish(&mut self, sums: &mut [T]) {
        self.sums.add_to(sums);
        self.sums.clear();
    }
}
