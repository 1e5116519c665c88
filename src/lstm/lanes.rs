//! Numbers that are computed together: kernels are written once, for one number at a time and for every width of vector.

use std::marker::PhantomData;

use pulp::{Arch, Simd, WithSimd};

use super::{Real, activation};

/// A way to compute with some numbers at once. Each number's result is the same whatever the width.
pub trait Lanes: Copy {
    /// What is computed with.
    type Number: Real;
    /// [`Self::WIDTH`] of them.
    type Value: Copy;
    /// Numbers in a value.
    const WIDTH: usize;

    /// The same number everywhere.
    fn splat(self, x: Self::Number) -> Self::Value;
    /// The first numbers of `from`.
    fn load(self, from: &[Self::Number]) -> Self::Value;
    /// Over the first numbers of `to`.
    fn store(self, to: &mut [Self::Number], x: Self::Value);
    /// `a + b`.
    fn add(self, a: Self::Value, b: Self::Value) -> Self::Value;
    /// `a − b`.
    fn sub(self, a: Self::Value, b: Self::Value) -> Self::Value;
    /// `a · b`.
    fn mul(self, a: Self::Value, b: Self::Value) -> Self::Value;
    /// `a / b`.
    fn div(self, a: Self::Value, b: Self::Value) -> Self::Value;
    /// `a · b + c`, rounded as [`Real::fma`] rounds.
    fn fma(self, a: Self::Value, b: Self::Value, c: Self::Value) -> Self::Value;
    /// |x|.
    fn abs(self, x: Self::Value) -> Self::Value;
    /// x within ± `bound`; not a number stays that.
    fn within(self, x: Self::Value, bound: Self::Number) -> Self::Value;
    /// As [`Real::fast_tanh`].
    fn tanh(self, x: Self::Value) -> Self::Value;

    /// As [`Real::fast_sigmoid`]: `½ + ½·tanh(x/2)`.
    #[inline(always)]
    fn sigmoid(self, x: Self::Value) -> Self::Value {
        let half = self.splat(Self::Number::of(0.5));
        self.fma(half, self.tanh(self.mul(half, x)), half)
    }
}

/// A computation over whole arrays.
pub trait Kernel<T> {
    /// Runs it. Belongs inlined, as everything it calls.
    fn run<L: Lanes<Number = T>>(self, lanes: L);
}

/// One number at a time.
#[derive(Debug)]
pub(super) struct Single<T>(PhantomData<T>);

impl<T> Clone for Single<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Single<T> {}

impl<T> Single<T> {
    /// The only one there is.
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self(PhantomData)
    }
}

impl<T: Real> Lanes for Single<T> {
    type Number = T;
    type Value = T;
    const WIDTH: usize = 1;

    #[inline(always)]
    fn splat(self, x: T) -> T {
        x
    }
    #[inline(always)]
    fn load(self, from: &[T]) -> T {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [T], x: T) {
        to[0] = x;
    }
    #[inline(always)]
    fn add(self, a: T, b: T) -> T {
        a + b
    }
    #[inline(always)]
    fn sub(self, a: T, b: T) -> T {
        a - b
    }
    #[inline(always)]
    fn mul(self, a: T, b: T) -> T {
        a * b
    }
    #[inline(always)]
    fn div(self, a: T, b: T) -> T {
        a / b
    }
    #[inline(always)]
    fn fma(self, a: T, b: T, c: T) -> T {
        a.fma(b, c)
    }
    #[inline(always)]
    fn abs(self, x: T) -> T {
        x.abs()
    }
    #[inline(always)]
    fn within(self, x: T, bound: T) -> T {
        x.clamp(-bound, bound)
    }
    #[inline(always)]
    fn tanh(self, x: T) -> T {
        x.fast_tanh()
    }
}

/// A vector of f32.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vectors<S>(S);

impl<S: Simd> Vectors<S> {
    /// Those of an instruction set.
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        Self(simd)
    }
}

impl<S: Simd> Lanes for Vectors<S> {
    type Number = f32;
    type Value = S::f32s;
    const WIDTH: usize = S::F32_LANES;

    #[inline(always)]
    fn splat(self, x: f32) -> S::f32s {
        self.0.splat_f32s(x)
    }
    #[inline(always)]
    fn load(self, from: &[f32]) -> S::f32s {
        S::as_simd_f32s(&from[..S::F32_LANES]).0[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [f32], x: S::f32s) {
        S::as_mut_simd_f32s(&mut to[..S::F32_LANES]).0[0] = x;
    }
    #[inline(always)]
    fn add(self, a: S::f32s, b: S::f32s) -> S::f32s {
        self.0.add_f32s(a, b)
    }
    #[inline(always)]
    fn sub(self, a: S::f32s, b: S::f32s) -> S::f32s {
        self.0.sub_f32s(a, b)
    }
    #[inline(always)]
    fn mul(self, a: S::f32s, b: S::f32s) -> S::f32s {
        self.0.mul_f32s(a, b)
    }
    #[inline(always)]
    fn div(self, a: S::f32s, b: S::f32s) -> S::f32s {
        self.0.div_f32s(a, b)
    }
    #[inline(always)]
    fn fma(self, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
        self.0.mul_add_f32s(a, b, c)
    }
    #[inline(always)]
    fn abs(self, x: S::f32s) -> S::f32s {
        self.0.abs_f32s(x)
    }
    #[inline(always)]
    fn within(self, x: S::f32s, bound: f32) -> S::f32s {
        let (simd, low, high) = (self.0, self.0.splat_f32s(-bound), self.0.splat_f32s(bound));
        if S::F32_LANES > 1 {
            // In this order vectors hand on what is not a number.
            return simd.min_f32s(high, simd.max_f32s(low, x));
        }
        let x = simd.select_f32s(simd.less_than_f32s(high, x), high, x);
        simd.select_f32s(simd.less_than_f32s(x, low), low, x)
    }
    #[inline(always)]
    fn tanh(self, x: S::f32s) -> S::f32s {
        activation::tanh(self, x)
    }
}

/// Runs a kernel with this machine's vectors.
pub(super) fn run_vectorised<K: Kernel<f32>>(kernel: K) {
    Arch::new().dispatch(Vectorised(kernel));
}

struct Vectorised<K>(K);

impl<K: Kernel<f32>> WithSimd for Vectorised<K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.0.run(Vectors(simd));
    }
}

/// Runs a kernel in one of the ways that there are; `false` where this machine has no such instructions.
#[cfg(test)]
pub(super) fn run_one_way<K: Kernel<f32>>(way: usize, kernel: K) -> bool {
    match way {
        0 => kernel.run(Single::new()),
        1 => kernel.run(Vectors(pulp::Scalar::new())),
        #[cfg(target_arch = "x86_64")]
        2 => match pulp::x86::V3::try_new() {
            Some(simd) => pulp::Simd::vectorize(simd, Vectorised(kernel)),
            None => return false,
        },
        3 => run_vectorised(kernel),
        _ => return false,
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Everything<'a> {
        x: &'a [f32],
        out: &'a mut [f32],
    }

    impl Kernel<f32> for Everything<'_> {
        #[inline(always)]
        fn run<L: Lanes<Number = f32>>(self, l: L) {
            for (x, out) in self.x.chunks_exact(L::WIDTH).zip(self.out.chunks_exact_mut(L::WIDTH)) {
                let x = l.load(x);
                let y = l.fma(x, l.splat(0.3), l.abs(l.sub(x, l.splat(1.5))));
                let y = l.add(l.tanh(l.mul(y, y)), l.sigmoid(l.div(x, l.splat(7.0))));
                l.store(out, l.within(y, 1.7));
            }
        }
    }

    #[test]
    fn every_width_gives_the_same_bits_and_keeps_what_is_not_a_number() {
        let mut x: Vec<f32> = (0..64).map(|i| (i as f32 - 31.0) * 0.37).collect();
        (x[3], x[40], x[41], x[60]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0);
        let run = |way: usize| {
            let mut out = vec![0.0_f32; x.len()];
            run_one_way(way, Everything { x: &x, out: &mut out }).then_some(out)
        };
        let single = run(0).expect("one number at a time");
        assert!(single[3].is_nan() && single[30] != single[31]);
        let bits = |out: &[f32]| out.iter().map(|x| if x.is_nan() { 0 } else { x.to_bits() }).collect::<Vec<_>>();
        for out in (1..4).filter_map(run) {
            assert_eq!(bits(&out), bits(&single));
        }
    }
}
