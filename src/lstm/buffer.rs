//! Buffers that are reused from call to call.

use super::Real;

/// At least this long; what is there stays.
pub(super) fn grow<T: Real>(buffer: &mut Vec<T>, len: usize) {
    if buffer.len() < len {
        buffer.resize(len, T::zero());
    }
}
