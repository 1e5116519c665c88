//! Matrix products by the `gemm` library, which training is measured against: the one place where safe views meet raw pointers.
#![allow(unsafe_code, reason = "the library takes pointers and strides")]

use nalgebra::{Dyn, MatrixView};

/// A matrix that is read with any strides: column-major as it is, or transposed.
pub(super) type Strided<'a> = MatrixView<'a, f32, Dyn, Dyn, Dyn, Dyn>;

/// `rows × columns` over column-major `values`.
///
/// # Panics
/// When there are too few.
pub(super) fn columns(values: &[f32], rows: usize, columns: usize) -> Strided<'_> {
    MatrixView::from_slice_with_strides_generic(values, Dyn(rows), Dyn(columns), Dyn(1), Dyn(rows))
}

/// `rows × columns` over row-major `values`: a transpose without moving anything.
///
/// # Panics
/// When there are too few.
pub(super) fn rows(values: &[f32], rows: usize, columns: usize) -> Strided<'_> {
    MatrixView::from_slice_with_strides_generic(values, Dyn(rows), Dyn(columns), Dyn(columns), Dyn(1))
}

/// `out ← lhs·rhs` for column-major `out` (`lhs` rows × `rhs` columns).
///
/// # Panics
/// When the shapes do not fit.
pub(super) fn product(out: &mut [f32], lhs: &Strided<'_>, rhs: &Strided<'_>) {
    let (m, k, n) = (lhs.nrows(), lhs.ncols(), rhs.ncols());
    assert!(k == rhs.nrows() && out.len() == m * n, "shapes fit: {m}×{k} times {}×{n} into {}", rhs.nrows(), out.len());
    let stride = |s: usize| isize::try_from(s).expect("a stride fits a pointer offset");
    // SAFETY: nalgebra's constructors checked that each view's shape and strides lie within its slice, `out` is m·n long
    // by the assertion and borrowed mutably (so it overlaps neither operand), and the strides are passed on as they are.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            out.as_mut_ptr(),
            stride(m),
            1,
            false,
            lhs.as_ptr(),
            stride(lhs.strides().1),
            stride(lhs.strides().0),
            rhs.as_ptr(),
            stride(rhs.strides().1),
            stride(rhs.strides().0),
            0.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn products_agree_with_nalgebra_for_every_orientation() {
        for (m, k, n) in [(1, 1, 1), (5, 3, 2), (64, 17, 33), (128, 512, 9)] {
            let a = DMatrix::<f32>::from_fn(m, k, |i, j| ((i * 7 + j * 3) % 11) as f32 - 5.0);
            let b = DMatrix::<f32>::from_fn(k, n, |i, j| ((i * 5 + j * 2) % 13) as f32 - 6.0);
            let expected = &a * &b;
            let (at, bt) = (a.transpose(), b.transpose());
            for lhs in [columns(a.as_slice(), m, k), rows(at.as_slice(), m, k)] {
                for rhs in [columns(b.as_slice(), k, n), rows(bt.as_slice(), k, n)] {
                    let mut out = vec![f32::NAN; m * n];
                    product(&mut out, &lhs, &rhs);
                    assert_eq!(out, expected.as_slice());
                }
            }
        }
    }
}
