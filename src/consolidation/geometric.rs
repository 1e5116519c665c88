//! Geometric means of absolute values, of many weights at once.

use std::f32::consts::{LN_2, LOG2_E, SQRT_2};

use crate::lstm::{Real, vectorised};

/// `Π_d |x_d|^(1/D)` of some vectors x, element by element.
///
/// Through logarithms, so that no product leaves the range of numbers. Within 10⁻⁵ of the true value: what it serves is an
/// estimate with an error of the order of one.
#[derive(Debug)]
pub(super) struct GeometricMean {
    log2_sums: Vec<f32>,
    count: u32,
}

impl GeometricMean {
    /// Of nothing yet.
    pub(super) fn new(len: usize) -> Self {
        Self { log2_sums: vec![0.0; len], count: 0 }
    }

    /// Takes another vector.
    pub(super) fn add<T: Real>(&mut self, values: &[T]) {
        self.count += 1;
        let sums = &mut self.log2_sums;
        vectorised(
            #[inline(always)]
            || {
                for (sum, x) in sums.iter_mut().zip(values) {
                    *sum += log2(x.wide().abs() as f32);
                }
            },
        );
    }

    /// Adds `scale` times the means to `sums`, and forgets them.
    pub(super) fn add_to<T: Real>(&mut self, scale: f64, sums: &mut [T]) {
        let (share, scale) = (1.0 / self.count as f32, T::of(scale));
        self.count = 0;
        let logs = &mut self.log2_sums;
        vectorised(
            #[inline(always)]
            || {
                for (sum, log) in sums.iter_mut().zip(logs) {
                    *sum += scale * T::of(f64::from(exp2(share * *log)));
                    *log = 0.0;
                }
            },
        );
    }
}

/// log₂ x of x ≥ 0, which for less than the smallest normal number, 0 too, is about −127; not a number for what is not finite.
/// Without branches, so that a loop over it vectorises.
///
/// `x = 2ᵉ·m` with m within √½ and √2, and the logarithm of m by the polynomial of Cephes (`logf`).
#[inline(always)]
#[expect(clippy::excessive_precision, reason = "the coefficients as published")]
fn log2(x: f32) -> f32 {
    const LEAST: u32 = (0.5 * SQRT_2).to_bits();
    const MANTISSA: u32 = 23;
    let above = x.to_bits().wrapping_sub(LEAST).cast_signed();
    let exponent = above >> MANTISSA;
    let m = f32::from_bits(x.to_bits().wrapping_sub((exponent << MANTISSA).cast_unsigned()));
    let f = m - 1.0;
    let p = 7.037_683_629_2e-2_f32;
    let p = p * f - 1.151_461_031_0e-1;
    let p = p * f + 1.167_699_874_0e-1;
    let p = p * f - 1.242_014_084_6e-1;
    let p = p * f + 1.424_932_278_7e-1;
    let p = p * f - 1.666_805_766_5e-1;
    let p = p * f + 2.000_071_476_5e-1;
    let p = p * f - 2.499_999_399_3e-1;
    let p = p * f + 3.333_333_117_4e-1;
    let ln = f + f * f * (f * p - 0.5);
    exponent as f32 + LOG2_E * ln + 0.0 * x
}

/// 2ˣ, 0 for x ≤ −127; x less than 127.
///
/// `2ⁿ·eʳ` with n the whole number next to x, and the series of eʳ for |r| ≤ ½ ln 2.
#[inline(always)]
fn exp2(x: f32) -> f32 {
    // A number that ends in units of 1: the last bits of x + TURN are n.
    const TURN: f32 = 12_582_912.0;
    const ONE: u32 = 1.0_f32.to_bits();
    let x = x.clamp(-127.0, 127.0);
    let turned = x + TURN;
    let scale = f32::from_bits((turned.to_bits() << 23).wrapping_add(ONE));
    let r = LN_2 * (x - (turned - TURN));
    let mut series = 1.0;
    for k in [7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0] {
        series = series * (r * (1.0 / k)) + 1.0;
    }
    scale * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_those_of_the_definition_over_the_whole_range() {
        let vectors: Vec<Vec<f32>> = (0..3)
            .map(|d| (0..2000).map(|i| (-1.0_f32).powi(i) * 10.0_f32.powf((i + d) as f32 * 0.035 - 35.0)).collect())
            .collect();
        let mut mean = GeometricMean::new(2000);
        for times in 0..2 {
            for values in &vectors {
                mean.add(values);
            }
            let mut sums = vec![1.0_f64; 2000];
            mean.add_to(0.5, &mut sums);
            for (i, sum) in sums.iter().enumerate() {
                let of_logs: f64 = vectors.iter().map(|values| f64::from(values[i].abs()).ln()).sum();
                let expected = 1.0 + 0.5 * (of_logs / 3.0).exp();
                assert!((sum / expected - 1.0).abs() < 1e-5, "{i}, {times}: {sum} {expected}");
            }
        }
    }

    #[test]
    fn nothing_has_no_mean_and_what_diverged_does_not_look_sane() {
        let mut mean = GeometricMean::new(3);
        for _ in 0..2 {
            mean.add(&[0.0_f32, f32::NAN, f32::NEG_INFINITY]);
        }
        let mut sums = [0.0_f32; 3];
        mean.add_to(1.0, &mut sums);
        assert!(sums[0] == 0.0 && sums[1].is_nan() && sums[2].is_nan(), "{sums:?}");
    }

    #[test]
    fn logarithms_and_powers_are_within_their_bound() {
        for i in -2_500_000..2_500_000 {
            let x = i as f32 * 5e-5;
            let (power, of_power) = (exp2(x), log2(x.exp2()));
            assert!((f64::from(power) / f64::from(x).exp2() - 1.0).abs() < 1e-6, "2^{x}: {power}");
            assert!((of_power - x).abs() < 1e-6 * x.abs().max(1.0), "log2 of 2^{x}: {of_power}");
        }
    }
}
