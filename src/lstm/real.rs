//! The number type of the arithmetic: f32 to serve and learn, f64 to check gradients against central differences.

use nalgebra::RealField;

use super::activation;
use super::lanes::{self, Kernel, Lanes, Single};

/// f32 or f64.
pub trait Real: RealField + Copy {
    /// The nearest value.
    fn of(x: f64) -> Self;
    /// As f64.
    fn wide(self) -> f64;
    /// Hyperbolic tangent, fast enough for inner loops; f32 within 4e-7 of the true value.
    #[must_use]
    fn fast_tanh(self) -> Self;
    /// Logistic function, likewise.
    #[must_use]
    fn fast_sigmoid(self) -> Self;
    /// `self · b + c`, rounded once where the hardware can.
    #[must_use]
    fn fma(self, b: Self, c: Self) -> Self;
    /// `σ(i), σ(f), tanh(g), σ(o)`, likewise.
    #[must_use]
    fn gates<L: Lanes<Number = Self>>(lanes: L, gates: [L::Value; 4]) -> [L::Value; 4];
    /// Runs a kernel: f32 with this machine's vectors.
    fn run(kernel: impl Kernel<Self>);
}

impl Real for f32 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x as f32
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn fast_tanh(self) -> Self {
        activation::tanh(Single::new(), self)
    }
    #[inline(always)]
    fn fast_sigmoid(self) -> Self {
        Single::new().sigmoid(self)
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        self.mul_add(b, c)
    }
    #[inline(always)]
    fn gates<L: Lanes<Number = Self>>(lanes: L, gates: [L::Value; 4]) -> [L::Value; 4] {
        activation::gates(lanes, gates)
    }
    fn run(kernel: impl Kernel<Self>) {
        lanes::run_vectorised(kernel);
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
    #[inline(always)]
    fn fast_tanh(self) -> Self {
        self.tanh()
    }
    #[inline(always)]
    fn fast_sigmoid(self) -> Self {
        Single::new().sigmoid(self)
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        self.mul_add(b, c)
    }
    #[inline(always)]
    fn gates<L: Lanes<Number = Self>>(l: L, [i, f, g, o]: [L::Value; 4]) -> [L::Value; 4] {
        [l.sigmoid(i), l.sigmoid(f), l.tanh(g), l.sigmoid(o)]
    }
    fn run(kernel: impl Kernel<Self>) {
        kernel.run(Single::new());
    }
}
