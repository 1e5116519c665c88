//! Linear quantiles.

/// `x[i] + f (x[i + 1] − x[i])` with i + f = q (n − 1), i whole and f in [0, 1): the definition of R's type 7 and of `NumPy`.
///
/// # Panics
/// Without values.
#[must_use]
pub fn quantile(sorted: &[f64], q: f64) -> f64 {
    let at = q * (sorted.len() - 1) as f64;
    let below = at as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + at.fract() * (sorted[above] - sorted[below])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_linear_between_neighbours() {
        // numpy.percentile([4, 1, 3, 2], [100 / 3, 200 / 3]) is [2, 3], of [5, 1, 2] it is [1.66…, 3].
        assert!((quantile(&[1.0, 2.0, 3.0, 4.0], 1.0 / 3.0) - 2.0).abs() < 1e-12);
        assert!((quantile(&[1.0, 2.0, 3.0, 4.0], 2.0 / 3.0) - 3.0).abs() < 1e-12);
        assert!((quantile(&[1.0, 2.0, 5.0], 1.0 / 3.0) - 5.0 / 3.0).abs() < 1e-12);
        assert!((quantile(&[1.0, 2.0, 5.0], 2.0 / 3.0) - 3.0).abs() < 1e-12);
        assert_eq!(quantile(&[7.0], 1.0 / 3.0), 7.0);
        assert_eq!([quantile(&[1.0, 9.0], 0.0), quantile(&[1.0, 9.0], 1.0)], [1.0, 9.0]);
    }
}
