//! Matrix products of the shapes that training multiplies: what the machine gives, by each library.

use nalgebra::DMatrix;

use super::gemm::{Strided, columns, product, rows};
use super::timing::seconds;
use crate::lstm::Layout;

/// The three products of an update, by what they give.
pub(super) const PRODUCTS: [&str; 3] = ["forward", "backward", "weights"];

/// One of [`PRODUCTS`] for `rows` rows of work: operands, result, and how they are multiplied.
pub(super) struct Bench {
    which: &'static str,
    layout: Layout,
    rows: usize,
    weights: Vec<f32>,
    states: Vec<f32>,
    gates: Vec<f32>,
    result: DMatrix<f32>,
}

impl Bench {
    pub(super) fn new(which: &'static str, layout: Layout, rows: usize) -> Self {
        let (hidden, gates) = (layout.hidden, layout.gates());
        let values = |len: usize| (0..len).map(|i| ((i * 7) % 13) as f32 / 13.0 - 0.5).collect();
        let result = match which {
            "forward" => DMatrix::zeros(gates, rows),
            "backward" => DMatrix::zeros(hidden, rows),
            _ => DMatrix::zeros(hidden, gates),
        };
        let (weights, states) = (values(gates * hidden), values(rows * hidden));
        Self { which, layout, rows, weights, states, gates: values(rows * gates), result }
    }

    /// Floating-point operations of one product.
    pub(super) fn flop(&self) -> f64 {
        2.0 * (self.layout.gates() * self.layout.hidden * self.rows) as f64
    }

    fn operands(&self) -> (Strided<'_>, Strided<'_>) {
        let (hidden, gates) = (self.layout.hidden, self.layout.gates());
        match self.which {
            "forward" => (rows(&self.weights, gates, hidden), columns(&self.states, hidden, self.rows)),
            "backward" => (columns(&self.weights, hidden, gates), columns(&self.gates, gates, self.rows)),
            _ => (columns(&self.states, hidden, self.rows), rows(&self.gates, self.rows, gates)),
        }
    }

    /// Multiplies with `gemm` `times` times; 10⁹ operations a second.
    pub(super) fn gemm(&mut self, times: usize) -> f64 {
        let mut result = std::mem::replace(&mut self.result, DMatrix::zeros(0, 0));
        let (lhs, rhs) = self.operands();
        let s = seconds(|| (0..times).for_each(|_| product(result.as_mut_slice(), &lhs, &rhs)));
        self.result = result;
        times as f64 * self.flop() / s / 1e9
    }

    /// Multiplies with nalgebra, likewise.
    pub(super) fn nalgebra(&mut self, times: usize) -> f64 {
        let mut result = std::mem::replace(&mut self.result, DMatrix::zeros(0, 0));
        let (lhs, rhs) = self.operands();
        // Its fast path takes matrices whose columns or rows are contiguous; this clone is that, once.
        let (lhs, rhs) = (lhs.clone_owned(), rhs.clone_owned());
        let s = seconds(|| (0..times).for_each(|_| result.gemm(1.0, &lhs, &rhs, 0.0)));
        self.result = result;
        times as f64 * self.flop() / s / 1e9
    }
}
