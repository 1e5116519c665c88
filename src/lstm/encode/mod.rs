//! Forward only, for serving: windows one by one or thousands together, the same bits either way.

mod packed;
mod states;
mod step;
#[cfg(test)]
mod tests;

use super::{Layout, vectorised};
use packed::Packed;
use states::Turning;
use step::Rows;

/// Fixed weights, arranged for serving.
///
/// Every sum runs over the hidden units in one order whatever the number of windows, so a window's answer does not depend on
/// who shares its batch.
#[derive(Debug, Clone)]
pub struct Encoder {
    layout: Layout,
    weights: Vec<f32>,
    packed: Packed,
}

/// States of the windows that are encoded together. Kept from call to call, whatever the encoder: once it has grown, nothing
/// is allocated.
#[derive(Debug, Default)]
pub struct EncoderBuffers {
    states: Turning,
}

/// The state of one vehicle that is encoded step by step.
#[derive(Debug, Clone)]
pub struct EncoderState {
    states: Turning,
    begun: bool,
}

/// The states of one vehicle's overlapping windows, which advance together: row n is the window that began n steps ago.
#[derive(Debug, Clone)]
pub struct OverlappingWindows {
    states: Turning,
    horizon: usize,
    /// Windows that have begun and are not full.
    open: usize,
}

impl Encoder {
    /// Windows that are encoded together: more do not make it faster.
    pub const TOGETHER: usize = 24;

    /// Arranges `weights`; `None` when their number does not fit the layout.
    #[must_use]
    pub fn new(layout: Layout, weights: Vec<f32>) -> Option<Self> {
        let fits = weights.len() == layout.len();
        fits.then(|| Self { layout, packed: Packed::new(layout, &weights), weights })
    }

    /// Its layout.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The flat vector.
    #[must_use]
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// The head's value for each window, into `values`; `inputs` are standardised, windows × steps × inputs.
    ///
    /// # Panics
    /// When there are more than [`Self::TOGETHER`] windows, or the number of inputs is not the same for each.
    pub fn head_values(&self, inputs: &[f32], buffers: &mut EncoderBuffers, values: &mut [f32]) {
        let (windows, each) = (values.len(), self.layout.inputs);
        if windows == 0 {
            return;
        }
        let window = inputs.len() / windows;
        assert!(
            windows <= Self::TOGETHER && inputs.len() == windows * window && window.is_multiple_of(each),
            "whole windows"
        );
        buffers.states.reserve(&self.packed, windows);
        for step in 0..window / each {
            let inputs = Rows { values: &inputs[step * each..], stride: window };
            let (later, beginning) = if step == 0 { (0, windows) } else { (windows, 0) };
            buffers.states.step(&self.packed, inputs, later, beginning);
        }
        for (n, value) in values.iter_mut().enumerate() {
            *value = self.head_value(buffers.states.row(&self.packed, n));
        }
    }

    /// The zero state.
    #[must_use]
    pub fn state(&self) -> EncoderState {
        let mut states = Turning::default();
        states.reserve(&self.packed, 1);
        EncoderState { states, begun: false }
    }

    /// Advances one vehicle's state by the standardised inputs of one step; the head's value then.
    ///
    /// The same bits as [`Self::head_values`] of a window that began when the state did.
    ///
    /// # Panics
    /// When the number of inputs does not fit.
    pub fn advance(&self, state: &mut EncoderState, inputs: &[f32]) -> f32 {
        assert_eq!(inputs.len(), self.layout.inputs);
        let (later, beginning) = if state.begun { (1, 0) } else { (0, 1) };
        state.states.step(&self.packed, Rows { values: inputs, stride: 0 }, later, beginning);
        state.begun = true;
        self.head_value(state.states.row(&self.packed, 0))
    }

    /// No window yet.
    ///
    /// # Panics
    /// When `horizon`, the steps of a window, is 0.
    #[must_use]
    pub fn overlapping_windows(&self, horizon: usize) -> OverlappingWindows {
        assert!(horizon > 0, "a window has steps");
        let mut states = Turning::default();
        states.reserve(&self.packed, horizon);
        OverlappingWindows { states, horizon, open: 0 }
    }

    /// Begins a window and advances those that are open, all in one product. The head's value for the one that is full then,
    /// if any: the same bits as [`Self::head_values`] of it.
    ///
    /// `inputs` are the standardised inputs of this step, for each window that [`OverlappingWindows::reading`] counts, the one
    /// that begins first; or one row, when all windows read the same.
    ///
    /// # Panics
    /// When the number of inputs does not fit.
    pub fn slide(&self, windows: &mut OverlappingWindows, inputs: &[f32]) -> Option<f32> {
        let each = self.layout.inputs;
        let stride = if inputs.len() == each { 0 } else { each };
        assert!(stride == 0 || inputs.len() == windows.reading() * each, "a row for each window");
        windows.states.step(&self.packed, Rows { values: inputs, stride }, windows.open, 1);
        let full = windows.reading() == windows.horizon;
        windows.open = windows.reading().min(windows.horizon - 1);
        full.then(|| self.head_value(windows.states.row(&self.packed, windows.horizon - 1)))
    }

    fn head_value(&self, h: &[f32]) -> f32 {
        vectorised(
            #[inline(always)]
            || self.packed.head_value(h),
        )
    }
}

impl OverlappingWindows {
    /// Windows that read the next step: the one that begins with it, and those that are open.
    #[must_use]
    pub fn reading(&self) -> usize {
        self.open + 1
    }

    /// Forgets every window.
    pub fn clear(&mut self) {
        self.open = 0;
    }
}
