//! Files that are handed out: they have a name, and most a tag that spares sending one twice.

use std::sync::Arc;

use axum::body::Body;
use axum::http::StatusCode;
use axum::http::header::{
    CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_TYPE, ETAG, HeaderMap, HeaderValue, IF_NONE_MATCH,
};
use axum::response::{IntoResponse, Response};
use tokio::sync::OwnedSemaphorePermit;

use super::AppState;
use super::problem::{Code, Problem};

/// Bytes handed on at once.
pub(super) const PIECE_BYTES: usize = 256 << 10;

/// A turn to hand out a version or what a batch holds, or to take a version in.
///
/// # Errors
/// 503 when all turns are taken.
pub(super) fn turn(app: &AppState) -> Result<OwnedSemaphorePermit, Problem> {
    let full = "as many files as the server hands out or takes in at once are under way";
    Arc::clone(&app.artifact_slots).try_acquire_owned().map_err(|_| Problem::busy(Code::Busy, full))
}

/// A body as a file of this name.
pub(super) fn file(name: &str, media_type: &'static str, body: Body) -> Response {
    let disposition = format!("attachment; filename=\"{name}\"");
    let mut response = Response::new(body);
    let told = response.headers_mut();
    told.insert(CONTENT_TYPE, HeaderValue::from_static(media_type));
    told.insert(CONTENT_DISPOSITION, HeaderValue::try_from(disposition).expect("names are letters and digits"));
    response
}

/// The digest that stands for all that is in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Tag(HeaderValue);

impl Tag {
    pub(super) fn new(digest: [u8; 32]) -> Self {
        Self(HeaderValue::try_from(format!("\"{}\"", hex::encode(digest))).expect("digits"))
    }

    /// 304, when the client has the file already.
    pub(super) fn not_modified(&self, headers: &HeaderMap) -> Option<Response> {
        let given = headers.get_all(IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
        let is_known = given.flat_map(|value| value.split(',')).any(|known| {
            let known = known.trim();
            known == "*" || known.trim_start_matches("W/").as_bytes() == self.0.as_bytes()
        });
        is_known.then(|| (StatusCode::NOT_MODIFIED, [(ETAG, self.0.clone())]).into_response())
    }

    /// Says it and the length of a file.
    pub(super) fn on(self, mut file: Response, bytes: u64) -> Response {
        let told = file.headers_mut();
        told.insert(CONTENT_LENGTH, bytes.into());
        told.insert(ETAG, self.0);
        file
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_known_is_not_sent_again() {
        let tag = Tag::new([0xab; 32]);
        let (own, other) = (format!("\"{}\"", "ab".repeat(32)), format!("\"{}\"", "cd".repeat(32)));
        let known = |given: &str| {
            let headers = HeaderMap::from_iter([(IF_NONE_MATCH, HeaderValue::from_str(given).unwrap())]);
            tag.not_modified(&headers).map(|response| response.status())
        };
        for given in [own.clone(), format!("{other}, W/{own}"), "*".to_owned()] {
            assert_eq!(known(&given), Some(StatusCode::NOT_MODIFIED), "{given}");
        }
        assert_eq!(known(&other), None);
        assert!(tag.not_modified(&HeaderMap::new()).is_none());
    }
}
