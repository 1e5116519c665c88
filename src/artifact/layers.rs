//! Torch's names for the parts of the flat parameter vector.

use std::ops::Range;

use crate::lstm::Layout;

/// One tensor: its name among the parameters of torch, its shape, and where it lies in the flat vector.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layer {
    /// Of a module with an `nn.LSTM` called `lstm` and an `nn.Linear` called `head`.
    pub name: &'static str,
    /// Row-major; gates in torch's order, input, forget, cell, output.
    pub shape: Vec<usize>,
    /// Its values, in this order, in the flat vector.
    pub range: Range<usize>,
}

/// Torch's second gate bias, which is added to the first; there is one sum in the flat vector, so here it is all zeros.
pub(super) const SECOND_BIAS: &str = "lstm.bias_hh_l0";

/// The tensors of a network, in the order of the flat vector, which they tile.
#[must_use]
pub fn layers(layout: Layout) -> [Layer; 5] {
    let (gates, hidden) = (layout.gates(), layout.hidden);
    [
        Layer { name: "lstm.weight_ih_l0", shape: vec![gates, layout.inputs], range: layout.input() },
        Layer { name: "lstm.weight_hh_l0", shape: vec![gates, hidden], range: layout.recurrent() },
        Layer { name: "lstm.bias_ih_l0", shape: vec![gates], range: layout.bias() },
        Layer { name: "head.weight", shape: vec![1, hidden], range: layout.head() },
        Layer { name: "head.bias", shape: vec![1], range: layout.head_bias()..layout.len() },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_as_large_as_their_parts_which_tile_the_vector() {
        let layout = Layout { hidden: 3, inputs: 7 };
        let mut at = 0;
        for layer in layers(layout) {
            assert_eq!((layer.range.start, layer.range.len()), (at, layer.shape.iter().product()), "{}", layer.name);
            at = layer.range.end;
        }
        assert_eq!(at, layout.len());
    }
}
