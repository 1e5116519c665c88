//! The cell: gates, state and their derivatives, for any width of vector.

use super::Real;
use super::lanes::{Lanes, Units};

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

/// The gates of a row's unit.
#[inline(always)]
fn load<L: Lanes>(l: L, rows: &[L::Number], row: usize, hidden: usize, unit: usize) -> Gates<L::Value> {
    let row = &rows[4 * row * hidden..][..4 * hidden];
    std::array::from_fn(
        #[inline(always)]
        |gate| l.load(&row[gate * hidden + unit..]),
    )
}

#[inline(always)]
fn store<L: Lanes>(l: L, rows: &mut [L::Number], row: usize, hidden: usize, unit: usize, gates: Gates<L::Value>) {
    let row = &mut rows[4 * row * hidden..][..4 * hidden];
    for (gate, value) in gates.into_iter().enumerate() {
        l.store(&mut row[gate * hidden + unit..], value);
    }
}

#[inline(always)]
fn add<L: Lanes>(l: L, rows: &mut [L::Number], row: usize, hidden: usize, unit: usize, by: Gates<L::Value>) {
    let sums = load(l, rows, row, hidden, unit);
    let sums = std::array::from_fn(
        #[inline(always)]
        |gate| l.add(sums[gate], by[gate]),
    );
    store(l, rows, row, hidden, unit, sums);
}

/// First steps of some rows: `z` is only written.
#[derive(Debug)]
pub(super) struct First<'a, T> {
    pub(super) hidden: usize,
    /// Projected inputs.
    pub(super) p: &'a [T],
    /// Takes the gates.
    pub(super) z: &'a mut [T],
    pub(super) c: &'a mut [T],
    pub(super) h: &'a mut [T],
}

impl<T: Real> Units<T> for First<'_, T> {
    #[inline(always)]
    fn size(&self) -> (usize, usize) {
        (self.c.len() / self.hidden, self.hidden)
    }

    #[inline(always)]
    fn unit<L: Lanes<Number = T>>(&mut self, l: L, row: usize, unit: usize) {
        let (hidden, at) = (self.hidden, row * self.hidden + unit);
        let (gates, c, h) = begin(l, load(l, self.p, row, hidden, unit));
        store(l, self.z, row, hidden, unit, gates);
        l.store(&mut self.c[at..], c);
        l.store(&mut self.h[at..], h);
    }
}

/// Later steps of some rows: `z` holds the recurrent products and gets the gates.
#[derive(Debug)]
pub(super) struct Later<'a, T> {
    pub(super) hidden: usize,
    /// Projected inputs.
    pub(super) p: &'a [T],
    pub(super) z: &'a mut [T],
    /// Cells before the step.
    pub(super) before: &'a [T],
    pub(super) c: &'a mut [T],
    pub(super) h: &'a mut [T],
}

impl<T: Real> Units<T> for Later<'_, T> {
    #[inline(always)]
    fn size(&self) -> (usize, usize) {
        (self.c.len() / self.hidden, self.hidden)
    }

    #[inline(always)]
    fn unit<L: Lanes<Number = T>>(&mut self, l: L, row: usize, unit: usize) {
        let (hidden, at) = (self.hidden, row * self.hidden + unit);
        let (z, p) = (load(l, self.z, row, hidden, unit), load(l, self.p, row, hidden, unit));
        let (gates, c, h) = go_on(l, z, p, l.load(&self.before[at..]));
        store(l, self.z, row, hidden, unit, gates);
        l.store(&mut self.c[at..], c);
        l.store(&mut self.h[at..], h);
    }
}

/// Backward through first steps of some rows: adds the derivatives by the gates' pre-activations to `sum`. The forget gate had
/// nothing to forget.
#[derive(Debug)]
pub(super) struct FirstBackward<'a, T> {
    pub(super) hidden: usize,
    /// Gates.
    pub(super) z: &'a [T],
    /// Cells after the step.
    pub(super) c: &'a [T],
    pub(super) dh: &'a [T],
    pub(super) dc: &'a [T],
    pub(super) sum: &'a mut [T],
}

impl<T: Real> Units<T> for FirstBackward<'_, T> {
    #[inline(always)]
    fn size(&self) -> (usize, usize) {
        (self.c.len() / self.hidden, self.hidden)
    }

    #[inline(always)]
    fn unit<L: Lanes<Number = T>>(&mut self, l: L, row: usize, unit: usize) {
        let (hidden, at) = (self.hidden, row * self.hidden + unit);
        let cells = (l.load(&self.c[at..]), l.splat(T::zero()));
        let by_state = (l.load(&self.dh[at..]), l.load(&self.dc[at..]));
        let (by, _) = back(l, load(l, self.z, row, hidden, unit), cells, by_state);
        add(l, self.sum, row, hidden, unit, by);
    }
}

/// Backward through later steps of some rows: writes the derivatives by the gates' pre-activations to `dz` and those by the
/// cells before the step, and adds the first to `sum` where rows share an input.
#[derive(Debug)]
pub(super) struct LaterBackward<'a, T> {
    pub(super) hidden: usize,
    /// Gates.
    pub(super) z: &'a [T],
    /// Cells after the step, and before it.
    pub(super) c: &'a [T],
    pub(super) before: &'a [T],
    pub(super) dh: &'a [T],
    pub(super) dc: &'a [T],
    pub(super) dz: &'a mut [T],
    pub(super) dc_before: &'a mut [T],
    pub(super) sum: Option<&'a mut [T]>,
}

impl<T: Real> Units<T> for LaterBackward<'_, T> {
    #[inline(always)]
    fn size(&self) -> (usize, usize) {
        (self.c.len() / self.hidden, self.hidden)
    }

    #[inline(always)]
    fn unit<L: Lanes<Number = T>>(&mut self, l: L, row: usize, unit: usize) {
        let (hidden, at) = (self.hidden, row * self.hidden + unit);
        let gates = load(l, self.z, row, hidden, unit);
        let cells = (l.load(&self.c[at..]), l.load(&self.before[at..]));
        let (by, dc) = back(l, gates, cells, (l.load(&self.dh[at..]), l.load(&self.dc[at..])));
        l.store(&mut self.dc_before[at..], l.mul(dc, gates[1]));
        store(l, self.dz, row, hidden, unit, by);
        if let Some(sum) = &mut self.sum {
            add(l, sum, row, hidden, unit, by);
        }
    }
}
