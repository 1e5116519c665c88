use axum::http::{HeaderMap, HeaderValue};
use headway::http::Code;
use headway::http::reading::inference;

/// Greatest number taken, m or m/s.
const GREATEST: f32 = 1e6;

/// What is taken is whole steps of usable numbers, however they were sent. The first two bytes are the length of the JSON, all
/// ones for a body that is nothing else.
pub(super) fn run(data: &[u8]) {
    let Some((length, body)) = data.split_first_chunk() else { return };
    let mut headers = HeaderMap::new();
    let length = u16::from_le_bytes(*length);
    if length != u16::MAX {
        headers.insert("inference-header-content-length", HeaderValue::from(length));
    }
    // A number is one of at least two bytes, and is kept in four, with room to grow.
    let most = 64 * data.len() as u64 + (64 << 10);
    match super::within(most, || inference(&headers, body)) {
        Ok((numbers, is_step)) => {
            assert!(numbers.len() % 4 == 0 && (!is_step || numbers.len() == 4));
            assert!(numbers.iter().all(|number| number.abs() <= GREATEST), "{numbers:?}");
        }
        Err(code) => {
            let expected = [Code::MalformedJson, Code::InvalidBody, Code::MalformedHeader];
            assert!(expected.contains(&code), "{code:?}");
        }
    }
}
