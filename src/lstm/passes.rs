//! Either way through the steps of some events.

use super::{Carried, Layout, Network, Overlap, Real};

/// How a network goes through events: every window from a zero state, or one state along each event.
#[derive(Debug)]
pub enum Passes<T> {
    /// Windows.
    Windows(Overlap<T>),
    /// One state.
    Carried(Carried<T>),
}

/// Calls the same function of either.
macro_rules! either {
    ($passes:expr, $each:ident => $call:expr) => {
        match $passes {
            Passes::Windows($each) => $call,
            Passes::Carried($each) => $call,
        }
    };
}

impl<T: Real> Passes<T> {
    /// Windows of the paper's network.
    #[must_use]
    pub fn windows(layout: Layout) -> Self {
        Self::Windows(Overlap::new(layout))
    }

    /// One state along each event.
    #[must_use]
    pub fn carried(layout: Layout) -> Self {
        Self::Carried(Carried::new(layout))
    }

    /// Begins with events of these many input steps each, longest first.
    pub fn begin(&mut self, horizon: usize, input_steps: &[usize]) {
        either!(self, passes => passes.begin(horizon, input_steps));
    }

    /// Input steps of the longest event.
    #[must_use]
    pub fn steps(&self) -> usize {
        either!(self, passes => passes.steps())
    }

    /// Events that step `t` reads: a prefix.
    #[must_use]
    pub fn events(&self, t: usize) -> usize {
        either!(self, passes => passes.events(t))
    }

    /// Events that answer at step `t`: a prefix.
    #[must_use]
    pub fn answering(&self, t: usize) -> usize {
        either!(self, passes => passes.answering(t))
    }

    /// Step `t` forward, from its inputs (`events(t)` rows) to one head value per answering event.
    pub fn forward(&mut self, network: &Network<T>, t: usize, inputs: &[T]) -> &[T] {
        either!(self, passes => passes.forward(network, t, inputs))
    }

    /// Step `t` backward, from the derivatives by its head values.
    pub fn backward(&mut self, network: &Network<T>, t: usize, dy: &[T], gradient: &mut [T]) {
        either!(self, passes => passes.backward(network, t, dy, gradient));
    }

    /// The derivatives by the inputs of step `t`, straight after it was gone back through; the open loop has no use for them.
    pub fn by_inputs(&mut self, network: &Network<T>, t: usize) -> &[T] {
        either!(self, passes => passes.by_inputs(network, t))
    }

    /// What of the gradient waited for all steps.
    pub fn finish(&mut self, gradient: &mut [T]) {
        either!(self, passes => passes.finish(gradient));
    }

    /// Events whose own gradients can be told apart after one way back.
    #[must_use]
    pub fn apart(&self) -> usize {
        match self {
            Self::Windows(_) => 1,
            Self::Carried(_) => usize::MAX,
        }
    }

    /// In place of [`Self::finish`]: makes `gradient`, which every step was gone back with, that of event `n` alone.
    ///
    /// # Panics
    /// When there are more events than can be told apart, or no such event.
    pub fn own(&mut self, n: usize, gradient: &mut [T]) {
        match self {
            Self::Windows(overlap) => {
                assert!(n == 0 && overlap.events(0) == 1, "windows add up whatever event they belong to");
                overlap.finish(gradient);
            }
            Self::Carried(carried) => carried.own(n, gradient),
        }
    }
}
