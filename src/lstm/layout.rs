//! Where each matrix begins: the only file that knows.

use std::ops::Range;

/// Inputs of the paper's network: follower speed, leader speed, relative speed, spacing.
pub const INPUTS: usize = 4;

/// The flat parameter vector of a network of some size.
///
/// | part | shape | order |
/// | --- | --- | --- |
/// | input weights | 4·hidden × inputs | row-major (`weight_ih` of torch) |
/// | recurrent weights | 4·hidden × hidden | row-major (`weight_hh`) |
/// | gate bias | 4·hidden | the sum of torch's two |
/// | head weights | hidden | |
/// | head bias | 1 | |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Hidden units.
    pub hidden: usize,
    /// Inputs of a step.
    pub inputs: usize,
}

impl Layout {
    /// Values of all four gates.
    #[must_use]
    pub fn gates(self) -> usize {
        4 * self.hidden
    }

    /// Parameters in all.
    #[must_use]
    pub fn len(self) -> usize {
        self.head_bias() + 1
    }

    /// Never: a network has parameters.
    #[must_use]
    pub fn is_empty(self) -> bool {
        false
    }

    /// Input weights.
    #[must_use]
    pub fn input(self) -> Range<usize> {
        0..self.gates() * self.inputs
    }

    /// Recurrent weights.
    #[must_use]
    pub fn recurrent(self) -> Range<usize> {
        let begin = self.input().end;
        begin..begin + self.gates() * self.hidden
    }

    /// Gate bias.
    #[must_use]
    pub fn bias(self) -> Range<usize> {
        let begin = self.recurrent().end;
        begin..begin + self.gates()
    }

    /// Head weights.
    #[must_use]
    pub fn head(self) -> Range<usize> {
        let begin = self.bias().end;
        begin..begin + self.hidden
    }

    /// Head bias.
    #[must_use]
    pub fn head_bias(self) -> usize {
        self.head().end
    }

    /// The parts by name, in order: for summaries per layer.
    #[must_use]
    pub fn parts(self) -> [(&'static str, Range<usize>); 5] {
        [
            ("input", self.input()),
            ("recurrent", self.recurrent()),
            ("bias", self.bias()),
            ("head", self.head()),
            ("head_bias", self.head_bias()..self.len()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_tile_the_vector() {
        let layout = Layout { hidden: 7, inputs: 5 };
        let mut at = 0;
        for (name, part) in layout.parts() {
            assert_eq!(part.start, at, "{name}");
            at = part.end;
        }
        assert_eq!(at, layout.len());
        assert_eq!(Layout { hidden: 128, inputs: INPUTS }.len(), 512 * (4 + 128 + 1) + 129);
    }
}
