//! One row of the cell: gates, state and their derivatives. Everything here runs inside a vectorised loop.

use super::Real;

/// Slices of the four gates of one row, in torch's order.
macro_rules! gates {
    ($row:expr, $hidden:expr) => {{
        let (i, rest) = $row.split_at($hidden);
        let (f, rest) = rest.split_at($hidden);
        let (g, o) = rest.split_at($hidden);
        (i, f, g, &o[..$hidden])
    }};
    (mut $row:expr, $hidden:expr) => {{
        let (i, rest) = $row.split_at_mut($hidden);
        let (f, rest) = rest.split_at_mut($hidden);
        let (g, o) = rest.split_at_mut($hidden);
        (i, f, g, &mut o[..$hidden])
    }};
}

/// The first step of a window, which starts from a zero state: `z` is only written.
///
/// `i, f, o = σ(p)`, `g = tanh(p)`, `c = i·g`, `h = o·tanh(c)`, p the row's projected input, gates left in `z`.
#[inline(always)]
pub(super) fn first<T: Real>(z: &mut [T], p: &[T], c: &mut [T], h: &mut [T]) {
    let n = c.len();
    let (zi, zf, zg, zo) = gates!(mut z, n);
    let (pi, pf, pg, po) = gates!(p, n);
    let h = &mut h[..n];
    for j in 0..n {
        let (i, g, o) = (pi[j].fast_sigmoid(), pg[j].fast_tanh(), po[j].fast_sigmoid());
        zi[j] = i;
        zf[j] = pf[j].fast_sigmoid();
        zg[j] = g;
        zo[j] = o;
        c[j] = i * g;
        h[j] = o * c[j].fast_tanh();
    }
}

/// A later step: `z` holds the recurrent product and gets the gates; `c = f·c' + i·g`, c' the state `before`.
#[inline(always)]
pub(super) fn later<T: Real>(z: &mut [T], p: &[T], before: &[T], c: &mut [T], h: &mut [T]) {
    let n = c.len();
    let (zi, zf, zg, zo) = gates!(mut z, n);
    let (pi, pf, pg, po) = gates!(p, n);
    let (before, h) = (&before[..n], &mut h[..n]);
    for j in 0..n {
        let i = (zi[j] + pi[j]).fast_sigmoid();
        let f = (zf[j] + pf[j]).fast_sigmoid();
        let g = (zg[j] + pg[j]).fast_tanh();
        let o = (zo[j] + po[j]).fast_sigmoid();
        zi[j] = i;
        zf[j] = f;
        zg[j] = g;
        zo[j] = o;
        c[j] = f.fma(before[j], i * g);
        h[j] = o * c[j].fast_tanh();
    }
}

/// Backward through [`first`]: gates in `z` become their pre-activations' derivatives, which `sum` also gathers.
#[inline(always)]
pub(super) fn first_backward<T: Real>(z: &mut [T], c: &[T], dh: &[T], dc: &[T], sum: &mut [T]) {
    let n = c.len();
    let (zi, zf, zg, zo) = gates!(mut z, n);
    let (si, sf, sg, so) = gates!(mut sum, n);
    let (dh, dc) = (&dh[..n], &dc[..n]);
    let _ = sf; // The forget gate has nothing to forget: its derivative is 0.
    for j in 0..n {
        let (i, g, o) = (zi[j], zg[j], zo[j]);
        let tanh_c = c[j].fast_tanh();
        let dc = (dh[j] * o).fma(T::one() - tanh_c * tanh_c, dc[j]);
        let di = dc * g * i * (T::one() - i);
        let dg = dc * i * (T::one() - g * g);
        let do_ = dh[j] * tanh_c * o * (T::one() - o);
        zi[j] = di;
        zf[j] = T::zero();
        zg[j] = dg;
        zo[j] = do_;
        si[j] += di;
        sg[j] += dg;
        so[j] += do_;
    }
}

/// Backward through [`later`]: likewise, and `dc` becomes the derivative by the state `before`.
#[inline(always)]
pub(super) fn later_backward<T: Real>(
    z: &mut [T],
    c: &[T],
    before: &[T],
    dh: &[T],
    dc: &[T],
    dc_before: &mut [T],
    sum: &mut [T],
) {
    let n = c.len();
    let (zi, zf, zg, zo) = gates!(mut z, n);
    let (si, sf, sg, so) = gates!(mut sum, n);
    let (before, dh, dc, dc_before) = (&before[..n], &dh[..n], &dc[..n], &mut dc_before[..n]);
    for j in 0..n {
        let (i, f, g, o) = (zi[j], zf[j], zg[j], zo[j]);
        let tanh_c = c[j].fast_tanh();
        let dc = (dh[j] * o).fma(T::one() - tanh_c * tanh_c, dc[j]);
        let di = dc * g * i * (T::one() - i);
        let df = dc * before[j] * f * (T::one() - f);
        let dg = dc * i * (T::one() - g * g);
        let do_ = dh[j] * tanh_c * o * (T::one() - o);
        dc_before[j] = dc * f;
        zi[j] = di;
        zf[j] = df;
        zg[j] = dg;
        zo[j] = do_;
        si[j] += di;
        sf[j] += df;
        sg[j] += dg;
        so[j] += do_;
    }
}
