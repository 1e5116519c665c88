//! One step forward: products and gates of a block of units at a time.

use super::Real;
use super::arranged::{Arranged, ROWS, Term, add_products, in_groups};
use super::gates::{begin, go_on};
use super::lanes::{Kernel, Lanes};
use super::lines::{GATES, LINE, Line, Lines};

/// The rows of one step. Gates are written as the way back needs them.
#[derive(Debug)]
pub(super) struct Forward<'a, T> {
    /// The recurrent weights, from units to gates.
    pub(super) weights: &'a Arranged<T>,
    /// The event of each row.
    pub(super) events: &'a [usize],
    /// Rows that begin, from a zero state.
    pub(super) begun: usize,
    /// `W_ih x + b` of each event, from row `first` on.
    pub(super) projected: Lines<'a, T>,
    pub(super) first: usize,
    /// States that the step before left.
    pub(super) h_before: Lines<'a, T>,
    pub(super) c_before: Lines<'a, T>,
    /// Takes the gates.
    pub(super) z: &'a mut [Line<T>],
    /// Take the states.
    pub(super) c: &'a mut [Line<T>],
    pub(super) h: &'a mut [Line<T>],
}

impl<T: Real> Kernel<T> for Forward<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, l: L) {
        let rows = self.events.len();
        let weights = self.weights;
        let z = self.z.chunks_exact_mut(GATES * rows);
        let states = self.c.chunks_exact_mut(rows).zip(self.h.chunks_exact_mut(rows));
        for (at, ((terms, z), (c, h))) in weights.blocks().zip(z).zip(states).enumerate() {
            let gates = std::array::from_fn(|gate| &self.projected.line(at * GATES + gate)[self.first..]);
            let mut z = z.chunks_exact_mut(rows);
            let z = std::array::from_fn(|_| z.next().expect("four gates"));
            let mut block = Block { gates, events: self.events, begun: self.begun, z, c, h };
            block.begin(l);
            let Some(c_before) = (rows > self.begun).then(|| self.c_before.line(at)) else { continue };
            let before = Before { terms, h: self.h_before, c: c_before };
            in_groups!(rows - self.begun, row => go_on_from::<L>(l, &mut block, &before, row));
        }
    }
}

/// A line of units of all rows.
struct Block<'a, T> {
    gates: [&'a [Line<T>]; GATES],
    events: &'a [usize],
    begun: usize,
    z: [&'a mut [Line<T>]; GATES],
    c: &'a mut [Line<T>],
    h: &'a mut [Line<T>],
}

struct Before<'a, T> {
    terms: &'a [Term<T>],
    h: Lines<'a, T>,
    c: &'a [Line<T>],
}

impl<'a, T: Real> Block<'a, T> {
    #[inline(always)]
    fn begin<L: Lanes<Number = T>>(&mut self, l: L) {
        for row in 0..self.begun {
            let p = self.projected(row);
            for at in (0..LINE).step_by(L::WIDTH) {
                let (gates, c, h) = begin(
                    l,
                    p.map(
                        #[inline(always)]
                        |p| l.load(&p.0[at..]),
                    ),
                );
                self.keep(l, row, at, gates, (c, h));
            }
        }
    }

    #[inline(always)]
    fn projected(&self, row: usize) -> [&'a Line<T>; GATES] {
        let event = self.events[row];
        self.gates.map(
            #[inline(always)]
            |p| &p[event],
        )
    }

    #[inline(always)]
    fn keep<L: Lanes<Number = T>>(
        &mut self,
        l: L,
        row: usize,
        at: usize,
        gates: [L::Value; GATES],
        (c, h): (L::Value, L::Value),
    ) {
        for (z, gate) in self.z.iter_mut().zip(gates) {
            l.store(&mut z[row].0[at..], gate);
        }
        l.store(&mut self.c[row].0[at..], c);
        l.store(&mut self.h[row].0[at..], h);
    }
}

/// `N` rows from `row` on of those that go on.
#[inline(always)]
fn go_on_from<L: Lanes, const N: usize>(
    l: L,
    block: &mut Block<'_, L::Number>,
    before: &Before<'_, L::Number>,
    row: usize,
) {
    let mut z = [[Line::zero(); GATES]; N];
    add_products(l, before.terms, (before.h, 0), row, GATES, &mut z);
    for n in 0..N {
        let (from, to) = (row + n, block.begun + row + n);
        let p = block.projected(to);
        for at in (0..LINE).step_by(L::WIDTH) {
            let z = std::array::from_fn(
                #[inline(always)]
                |gate| l.load(&z[n][gate].0[at..]),
            );
            let p = p.map(
                #[inline(always)]
                |p| l.load(&p.0[at..]),
            );
            let (gates, c, h) = go_on(l, z, p, l.load(&before.c[from].0[at..]));
            block.keep(l, to, at, gates, (c, h));
        }
    }
}
