//! An answer that is complete in memory: it can be sent, and kept to be sent again.

use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HeaderName, HeaderValue};
use axum::http::{Response as HttpResponse, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use crate::store::idempotency::StoredAnswer;

/// Status, headers, body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer(StoredAnswer);

impl Answer {
    /// `body` as JSON.
    ///
    /// # Panics
    /// When `body` does not serialize; bodies of the interface do.
    #[must_use]
    pub fn json<T: Serialize + ?Sized>(status: StatusCode, body: &T) -> Self {
        Self(StoredAnswer {
            status: status.as_u16(),
            headers: vec![(CONTENT_TYPE.to_string(), "application/json".to_owned())],
            body: serde_json::to_vec(body).expect("bodies of the interface serialize"),
        })
    }

    /// A 200 with `body` as JSON.
    #[must_use]
    pub fn ok<T: Serialize + ?Sized>(body: &T) -> Self {
        Self::json(StatusCode::OK, body)
    }

    /// With a header, replacing one of the same name.
    #[must_use]
    pub fn with_header(mut self, name: &HeaderName, value: impl Into<String>) -> Self {
        self.0.headers.retain(|(present, _)| present != name.as_str());
        self.0.headers.push((name.as_str().to_owned(), value.into()));
        self
    }

    /// As the store keeps it.
    #[must_use]
    pub fn as_stored(&self) -> &StoredAnswer {
        &self.0
    }

    /// As the store keeps it.
    #[must_use]
    pub fn into_stored(self) -> StoredAnswer {
        self.0
    }
}

/// A 200 with `body` as JSON that nobody keeps.
///
/// # Panics
/// When `body` does not serialize; bodies of the interface do.
pub(super) fn ok_json<T: Serialize>(body: &T) -> Response {
    let bytes = serde_json::to_vec(body).expect("bodies of the interface serialize");
    let mut response = HttpResponse::new(Body::from(bytes));
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static("application/json"));
    response
}

impl From<StoredAnswer> for Answer {
    /// A stored answer, marked as replayed.
    fn from(stored: StoredAnswer) -> Self {
        Self(stored).with_header(&HeaderName::from_static("idempotency-replayed"), "true")
    }
}

impl IntoResponse for Answer {
    fn into_response(self) -> Response {
        let StoredAnswer { status, headers, body } = self.0;
        let mut response = HttpResponse::new(Body::from(body));
        *response.status_mut() = StatusCode::from_u16(status).expect("made from a status");
        for (name, value) in headers {
            let name = HeaderName::try_from(name).expect("made from a header name");
            let value = HeaderValue::try_from(value).expect("headers of the interface are ASCII");
            response.headers_mut().insert(name, value);
        }
        response
    }
}
