//! Every way the interface says no (RFC 9457).

/// The table of kinds.
mod code;

use std::borrow::Cow;

use axum::http::HeaderMap;
use axum::http::header::{CONTENT_TYPE, HeaderName, HeaderValue, RETRY_AFTER};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::{Map, Value, json};

pub use code::Code;

use super::answer::Answer;
use crate::lineage;
use crate::store::StoreError;

/// What a problem says of the request it answers.
#[derive(Debug, Clone)]
pub struct RequestContext {
    /// The client's `x-request-id` when it is usable, else one of ours.
    pub request_id: String,
    /// The request's path.
    pub path: String,
}

/// One thing wrong with the input.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct InputError {
    /// Where.
    #[serde(flatten)]
    pub place: Place,
    /// Stable name.
    pub code: Cow<'static, str>,
    /// For a person.
    pub detail: String,
}

/// Where in a request.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// A JSON pointer (RFC 6901) into the body.
    Pointer(String),
    /// A query parameter.
    Parameter(String),
    /// A line of an NDJSON body, from 1.
    Line(u64),
    /// A data row of a tabular body, from 1.
    Row(u64),
}

impl InputError {
    /// Wrong at a JSON pointer.
    #[must_use]
    pub fn at(pointer: impl Into<String>, code: &'static str, detail: impl Into<String>) -> Self {
        Self { place: Place::Pointer(pointer.into()), code: code.into(), detail: detail.into() }
    }

    /// Wrong at a place of an uploaded body.
    #[must_use]
    pub fn within(place: &lineage::Place, code: &'static str, detail: impl Into<String>) -> Self {
        let place = match place {
            lineage::Place::Pointer(pointer) => Place::Pointer(pointer.clone()),
            lineage::Place::Line(line) => Place::Line(*line),
            lineage::Place::Row(row) => Place::Row(*row),
        };
        Self { place, code: code.into(), detail: detail.into() }
    }

    /// Wrong in a query parameter.
    #[must_use]
    pub fn parameter(name: impl Into<String>, code: &'static str, detail: impl Into<String>) -> Self {
        Self { place: Place::Parameter(name.into()), code: code.into(), detail: detail.into() }
    }
}

/// A refusal, to become `application/problem+json`.
#[derive(Debug, Clone)]
pub struct Problem(Box<Contents>);

#[derive(Debug, Clone)]
struct Contents {
    code: Code,
    detail: Cow<'static, str>,
    errors: Vec<InputError>,
    extensions: Map<String, Value>,
    headers: HeaderMap,
    /// Logged, never sent.
    cause: Option<String>,
}

impl Problem {
    /// A 500: the cause is for the log alone.
    #[must_use]
    pub fn internal(cause: impl std::fmt::Display) -> Self {
        Code::Internal.because("the log tells more under this request id").with_cause(cause)
    }

    /// A 507: what was to be stored finds no room.
    #[must_use]
    pub fn full(cause: impl std::fmt::Display) -> Self {
        let detail =
            "nothing was changed, and predictions go on; the same request may be sent again once there is room";
        Self::busy(Code::StorageFull, detail).with_cause(cause)
    }

    /// With a cause that is for the log alone.
    #[must_use]
    fn with_cause(mut self, cause: impl std::fmt::Display) -> Self {
        self.0.cause = Some(cause.to_string());
        self
    }

    /// A 503 or 507 that asks to come back in a second.
    #[must_use]
    pub fn busy(code: Code, detail: impl Into<Cow<'static, str>>) -> Self {
        code.because(detail).with_header(RETRY_AFTER, HeaderValue::from_static("1"))
    }

    /// With one more thing wrong with the input.
    #[must_use]
    pub fn with_error(mut self, error: InputError) -> Self {
        self.0.errors.push(error);
        self
    }

    /// With these things wrong with the input.
    #[must_use]
    pub fn with_errors(mut self, errors: Vec<InputError>) -> Self {
        self.0.errors.extend(errors);
        self
    }

    /// With a further member.
    #[must_use]
    pub fn with_members(mut self, members: Map<String, Value>) -> Self {
        self.0.extensions.extend(members);
        self
    }

    /// With a header.
    #[must_use]
    pub fn with_header(mut self, name: HeaderName, value: HeaderValue) -> Self {
        self.0.headers.insert(name, value);
        self
    }

    /// What kind it is.
    #[must_use]
    pub fn code(&self) -> Code {
        self.0.code
    }

    /// What the log should know and the client should not.
    #[must_use]
    pub fn cause(&self) -> Option<&str> {
        self.0.cause.as_deref()
    }

    /// The answer to the request of `context`.
    #[must_use]
    pub fn answer(&self, context: &RequestContext) -> Answer {
        let Contents { code, detail, errors, extensions, headers, .. } = &*self.0;
        let (name, status, title) = code.row();
        let mut body = json!({
            "type": format!("/problems/{name}"),
            "title": title,
            "status": status.as_u16(),
            "detail": detail,
            "instance": context.path,
            "code": name,
            "request_id": context.request_id,
        });
        let members = body.as_object_mut().expect("an object");
        if !errors.is_empty() {
            members.insert("errors".to_owned(), json!(errors));
        }
        members.extend(extensions.clone());
        let answer = Answer::json(status, &body).with_header(&CONTENT_TYPE, "application/problem+json");
        headers
            .iter()
            .fold(answer, |answer, (name, value)| answer.with_header(name, value.to_str().expect("set by this crate")))
    }
}

/// Rendered by the outermost layer, which knows the request.
impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut response = self.0.code.row().1.into_response();
        response.extensions_mut().insert(self);
        response
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Busy => {
                Self::busy(Code::DatabaseBusy, "nothing was changed; the same request may be sent again")
            }
            StoreError::Corrupt { detail, .. } => Code::Corrupt.because(detail),
            error @ StoreError::Full(_) => Self::full(error),
            error @ StoreError::ReadOnly(_) => {
                let detail = "nothing was changed; predictions go on";
                Self::busy(Code::DatabaseReadOnly, detail).with_cause(error)
            }
            error => Self::internal(error),
        }
    }
}

impl From<crate::lineage::SettingsError> for Problem {
    fn from(error: crate::lineage::SettingsError) -> Self {
        let pointer = if error.name.is_empty() { "/settings".to_owned() } else { format!("/settings/{}", error.name) };
        Code::InvalidSettings.because(error.to_string()).with_error(InputError::at(pointer, error.code, error.detail))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_internal_problem_keeps_its_cause_to_itself() {
        let context = RequestContext { request_id: "r1".to_owned(), path: "/v1/models".to_owned() };
        let problem = Problem::internal("disk on fire");
        let body = String::from_utf8(problem.answer(&context).into_stored().body).unwrap();
        assert!(!body.contains("fire") && body.contains("r1"), "{body}");
        assert_eq!(problem.cause(), Some("disk on fire"));
    }
}
