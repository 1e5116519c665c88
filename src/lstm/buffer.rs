//! Buffers that are reused from call to call.

use std::ops::{Deref, DerefMut};

use super::Real;

/// At least this long; what is there stays.
pub(super) fn grow<T: Real>(buffer: &mut Vec<T>, len: usize) {
    if buffer.len() < len {
        buffer.resize(len, T::zero());
    }
}

/// A buffer that begins at a line of the cache, so that no vector of its rows lies across two: each of those is read twice.
#[derive(Debug)]
pub(super) struct Aligned<T> {
    values: Vec<T>,
    skipped: usize,
}

impl<T: Real> Aligned<T> {
    /// Bytes of a line.
    const LINE: usize = 64;

    /// Nothing yet.
    pub(super) fn new() -> Self {
        Self { values: Vec::new(), skipped: 0 }
    }

    /// At least this long; what is there is lost if it was shorter.
    pub(super) fn grow(&mut self, len: usize) {
        if self.len() < len {
            self.values.clear();
            self.values.resize(len + Self::LINE / size_of::<T>(), T::zero());
            self.skipped = self.values.as_ptr().align_offset(Self::LINE).min(self.values.len() - len);
        }
    }
}

impl<T> Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values[self.skipped..]
    }
}

impl<T> DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[self.skipped..]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_begins_at_a_line_and_never_shrinks() {
        let mut buffer = Aligned::<f32>::new();
        assert!(buffer.is_empty());
        for (len, least) in [(3, 3), (1000, 1000), (1, 1000), (70_000, 70_000)] {
            buffer.grow(len);
            assert!(buffer.len() >= least && buffer.as_ptr().addr().is_multiple_of(Aligned::<f32>::LINE));
            buffer[least - 1] = 1.0;
        }
    }
}
