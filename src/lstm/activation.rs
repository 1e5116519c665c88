//! tanh as a rational function, without branches, so that a loop over it vectorises.

/// Beyond this the result is ±1 to f32 accuracy.
const SATURATION: f32 = 7.905_311;

/// tanh(x) ≈ x·P(x²)/Q(x²) with P of degree 6 and Q of degree 3 on [−7.9, 7.9]: the minimax fit that Eigen uses
/// (`generic_fast_tanh_float`). Error at most 4e-7, tested against f64.
#[inline(always)]
#[expect(clippy::excessive_precision, reason = "the coefficients as published")]
pub(super) fn tanh(x: f32) -> f32 {
    let x = x.clamp(-SATURATION, SATURATION);
    let x2 = x * x;
    let p = x2.mul_add(-2.760_768_5e-16, 2.000_187_9e-13);
    let p = x2.mul_add(p, -8.604_671_5e-11);
    let p = x2.mul_add(p, 5.122_297_1e-8);
    let p = x2.mul_add(p, 1.485_722_4e-5);
    let p = x2.mul_add(p, 6.372_619_3e-4);
    let p = x2.mul_add(p, 4.893_524_6e-3);
    let q = x2.mul_add(1.198_258_4e-6, 1.185_347_1e-4);
    let q = x2.mul_add(q, 2.268_434_6e-3);
    let q = x2.mul_add(q, 4.893_525_2e-3);
    (x * p / q).clamp(-1.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lstm::Real;

    #[test]
    fn tanh_and_sigmoid_are_within_their_bound_everywhere() {
        let mut worst = (0.0_f64, 0.0_f64);
        for i in -2_000_000..=2_000_000_i32 {
            let x = i as f32 * 1e-5;
            worst.0 = worst.0.max((f64::from(tanh(x)) - f64::from(x).tanh()).abs());
            let sigmoid = 1.0 / (1.0 + (-f64::from(x)).exp());
            worst.1 = worst.1.max((f64::from(x.fast_sigmoid()) - sigmoid).abs());
        }
        assert!(worst.0 < 4e-7 && worst.1 < 4e-7, "{worst:?}");
    }

    #[test]
    fn small_arguments_keep_their_relative_accuracy() {
        for exponent in 1..30 {
            let x = 2.0_f32.powi(-exponent);
            let relative = (f64::from(tanh(x)) / f64::from(x).tanh() - 1.0).abs();
            assert!(relative < 1e-6, "{x}: {relative}");
        }
    }

    #[test]
    fn extremes_stay_within_one() {
        for x in [f32::MAX, 1e30, 100.0, 7.9, f32::INFINITY] {
            assert!(tanh(x) <= 1.0 && tanh(x) > 0.999_999);
            assert_eq!(tanh(-x), -tanh(x));
        }
        assert!(tanh(f32::NAN).is_nan(), "a diverged network must not look sane");
    }
}
