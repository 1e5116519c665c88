//! tanh as a rational function, without branches, so that a loop over it vectorises.

use super::lanes::Lanes;

/// Beyond this the result is ±1 to f32 accuracy.
const SATURATION: f32 = 7.905_311;

/// tanh(x) ≈ x·P(x²)/Q(x²) with P of degree 6 and Q of degree 3 on [−7.9, 7.9]: the minimax fit that Eigen uses
/// (`generic_fast_tanh_float`). Error at most 4e-7, tested against f64.
#[inline(always)]
pub(super) fn tanh<L: Lanes<Number = f32>>(l: L, x: L::Value) -> L::Value {
    let (p, q) = ratio(l, x);
    l.within(l.div(p, q), 1.0)
}

/// σ, σ, tanh and σ of the four gates with one division for all of them: division is the slowest of the operations, and
/// `1/a = b·(1/ab)`. Q lies within 0.0048 and 1, so that no product of four leaves the range of f32.
#[inline(always)]
pub(super) fn gates<L: Lanes<Number = f32>>(l: L, [i, f, g, o]: [L::Value; 4]) -> [L::Value; 4] {
    let (half, one) = (l.splat(0.5), l.splat(1.0));
    let [(pi, qi), (pf, qf), (pg, qg), (po, qo)] =
        [ratio(l, l.mul(half, i)), ratio(l, l.mul(half, f)), ratio(l, g), ratio(l, l.mul(half, o))];
    let (q_if, q_go) = (l.mul(qi, qf), l.mul(qg, qo));
    let all = l.div(one, l.mul(q_if, q_go));
    let (by_if, by_go) = (l.mul(all, q_go), l.mul(all, q_if));
    let i = l.within(l.mul(pi, l.mul(by_if, qf)), 1.0);
    let f = l.within(l.mul(pf, l.mul(by_if, qi)), 1.0);
    let g = l.within(l.mul(pg, l.mul(by_go, qo)), 1.0);
    let o = l.within(l.mul(po, l.mul(by_go, qg)), 1.0);
    [l.fma(half, i, half), l.fma(half, f, half), g, l.fma(half, o, half)]
}

/// Numerator and denominator of tanh(x).
#[inline(always)]
#[expect(clippy::excessive_precision, reason = "the coefficients as published")]
fn ratio<L: Lanes<Number = f32>>(l: L, x: L::Value) -> (L::Value, L::Value) {
    let x = l.within(x, SATURATION);
    let x2 = l.mul(x, x);
    let p = l.fma(x2, l.splat(-2.760_768_5e-16), l.splat(2.000_187_9e-13));
    let p = l.fma(x2, p, l.splat(-8.604_671_5e-11));
    let p = l.fma(x2, p, l.splat(5.122_297_1e-8));
    let p = l.fma(x2, p, l.splat(1.485_722_4e-5));
    let p = l.fma(x2, p, l.splat(6.372_619_3e-4));
    let p = l.fma(x2, p, l.splat(4.893_524_6e-3));
    let q = l.fma(x2, l.splat(1.198_258_4e-6), l.splat(1.185_347_1e-4));
    let q = l.fma(x2, q, l.splat(2.268_434_6e-3));
    let q = l.fma(x2, q, l.splat(4.893_525_2e-3));
    (l.mul(x, p), q)
}

#[cfg(test)]
mod tests {
    use crate::lstm::Real;
    use crate::lstm::lanes::Single;

    fn tanh(x: f32) -> f32 {
        x.fast_tanh()
    }

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
    fn gates_that_share_a_division_are_within_their_bound_wherever_the_others_are() {
        let mut worst = [0.0_f64; 4];
        for i in -20_000..=20_000_i32 {
            let x = i as f32 * 1e-3;
            for others in [-30.0, -4.0, 0.0, 0.7, 30.0] {
                for gate in 0..4 {
                    let mut z = [others; 4];
                    z[gate] = x;
                    let value = f64::from(f32::gates(Single::<f32>::new(), z)[gate]);
                    let x = f64::from(x);
                    let exact = if gate == 2 { x.tanh() } else { 1.0 / (1.0 + (-x).exp()) };
                    worst[gate] = worst[gate].max((value - exact).abs());
                }
            }
        }
        assert!(worst.into_iter().all(|off| off < 4e-7), "{worst:?}");
        let [i, f, g, o] = f32::gates(Single::<f32>::new(), [0.0, f32::NAN, 0.0, f32::INFINITY]);
        assert!(
            f.is_nan() && o.is_nan() == i.is_nan() && i.is_nan() == g.is_nan(),
            "a diverged network must not look sane"
        );
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
