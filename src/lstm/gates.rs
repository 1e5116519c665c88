//! The cell: gates, state and their derivatives, for any width of vector.

use super::Real;
use super::lanes::Lanes;

/// The four gates of one or more units, in torch's order: input, forget, cell, output.
type Gates<V> = [V; 4];

/// The gates and the state (cell, hidden) after the first step of a window, which starts from a zero state:
/// `i, f, o = σ(p)`, `g = tanh(p)`, `c = i·g`, `h = o·tanh(c)`, p the projected input.
#[inline(always)]
pub(super) fn begin<L: Lanes>(l: L, p: Gates<L::Value>) -> (Gates<L::Value>, L::Value, L::Value) {
    let [i, f, g, o] = L::Number::gates(l, p);
    let c = l.mul(i, g);
    ([i, f, g, o], c, l.mul(o, l.tanh(c)))
}

/// The gates and the state after a later step: `i, f, o = σ(z + p)`, `g = tanh(z + p)`, `c = f·c' + i·g`, z the recurrent product,
/// c' the cell `before`.
#[inline(always)]
pub(super) fn go_on<L: Lanes>(
    l: L,
    z: Gates<L::Value>,
    p: Gates<L::Value>,
    before: L::Value,
) -> (Gates<L::Value>, L::Value, L::Value) {
    let [i, f, g, o] = L::Number::gates(
        l,
        std::array::from_fn(
            #[inline(always)]
            |gate| l.add(z[gate], p[gate]),
        ),
    );
    let c = l.fma(f, before, l.mul(i, g));
    ([i, f, g, o], c, l.mul(o, l.tanh(c)))
}

/// The derivatives by the gates' pre-activations, and by the cell itself, from those by the state after the step; `before` is
/// the cell before it, which the forget gate multiplies.
#[inline(always)]
pub(super) fn back<L: Lanes>(
    l: L,
    [i, f, g, o]: Gates<L::Value>,
    (c, before): (L::Value, L::Value),
    (dh, dc): (L::Value, L::Value),
) -> (Gates<L::Value>, L::Value) {
    let one = l.splat(L::Number::of(1.0));
    let slope = |sigmoid| l.mul(sigmoid, l.sub(one, sigmoid));
    let tanh_c = l.tanh(c);
    let dc = l.fma(l.mul(dh, o), l.sub(one, l.mul(tanh_c, tanh_c)), dc);
    let di = l.mul(l.mul(dc, g), slope(i));
    let df = l.mul(l.mul(dc, before), slope(f));
    let dg = l.mul(l.mul(dc, i), l.sub(one, l.mul(g, g)));
    let do_ = l.mul(l.mul(dh, tanh_c), slope(o));
    ([di, df, dg, do_], dc)
}
