//! Changes of bytes, drawn from a seed.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::Kept;

/// Most changes of one input, and most bytes that one of them adds.
const MOST: usize = 6;
const MOST_BYTES: usize = 64;

/// Numbers that decoders stumble over.
const ODD: [&[u8]; 8] =
    [b"\0", b"\xff", b"\x7f", b"\xff\xff\xff\xff\x07", b"\xff\xff\xff\xff\xff\xff\xff\x7f", b"-", b"1e999", b"\""];

/// One changed input after another.
pub(crate) struct Changes(ChaCha8Rng);

impl Changes {
    pub(crate) fn new(seed: u64, target: &str) -> Self {
        let named = target.bytes().fold(seed, |sum, byte| sum.wrapping_mul(31).wrapping_add(u64::from(byte)));
        Self(ChaCha8Rng::seed_from_u64(named))
    }

    /// One of `kept`, changed in a few places.
    pub(crate) fn next(&mut self, kept: &Kept) -> Vec<u8> {
        let one = |rng: &mut ChaCha8Rng| &kept[rng.random_range(0..kept.len())].1;
        let mut bytes = one(&mut self.0).clone();
        for _ in 0..self.0.random_range(1..=MOST) {
            let other = one(&mut self.0);
            let (at, part, of_other) = (self.place(&bytes), self.part(&bytes), self.part(other));
            match self.0.next_u32() % 7 {
                0 if at < bytes.len() => bytes[at] ^= 1 << (self.0.next_u32() % 8),
                1 if at < bytes.len() => bytes[at] = self.0.next_u32() as u8,
                2 => drop(bytes.drain(part)),
                3 => {
                    let copy = bytes[part].to_vec();
                    drop(bytes.splice(at..at, copy));
                }
                4 => drop(bytes.splice(part, other[of_other].iter().copied())),
                5 => drop(bytes.splice(at..at, ODD[at % ODD.len()].iter().copied())),
                _ => bytes.truncate(at),
            }
        }
        bytes
    }

    fn place(&mut self, bytes: &[u8]) -> usize {
        self.0.random_range(0..=bytes.len())
    }

    fn part(&mut self, bytes: &[u8]) -> std::ops::Range<usize> {
        let from = self.place(bytes);
        from..(from + self.0.random_range(0..=MOST_BYTES)).min(bytes.len())
    }
}
