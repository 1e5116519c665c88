//! Arrays as stored: their numbers one after another, little-endian.

use super::StoreError;

/// Weights, anchors and importance as stored: f32.
#[must_use]
pub fn stored_floats(values: &[f32]) -> Vec<u8> {
    values.iter().map(|x| x.to_le_bytes()).collect::<Vec<_>>().into_flattened()
}

/// The values whose [`stored_floats`] these are.
///
/// # Errors
/// When the length does not fit.
pub fn floats(what: &'static str, bytes: &[u8]) -> Result<Vec<f32>, StoreError> {
    numbers(what, "f32", bytes, f32::from_le_bytes)
}

/// Ids of events as stored: i64.
#[must_use]
pub fn stored_integers(ids: &[i64]) -> Vec<u8> {
    ids.iter().map(|id| id.to_le_bytes()).collect::<Vec<_>>().into_flattened()
}

/// The ids whose [`stored_integers`] these are.
///
/// # Errors
/// When the length does not fit.
pub fn integers(what: &'static str, bytes: &[u8]) -> Result<Vec<i64>, StoreError> {
    numbers(what, "i64", bytes, i64::from_le_bytes)
}

fn numbers<const N: usize, X>(
    what: &'static str,
    kind: &str,
    bytes: &[u8],
    read: impl Fn([u8; N]) -> X,
) -> Result<Vec<X>, StoreError> {
    let (values, rest) = bytes.as_chunks::<N>();
    if !rest.is_empty() {
        return Err(StoreError::malformed(what, format!("{} bytes are no whole number of {kind}", bytes.len())));
    }
    Ok(values.iter().map(|value| read(*value)).collect())
}
