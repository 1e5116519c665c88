//! Every way the interface says no: one code, one status, one title each (RFC 9457).

use std::borrow::Cow;

use axum::http::header::{CONTENT_TYPE, HeaderName, HeaderValue, RETRY_AFTER};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::{Map, Value, json};

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

/// Stable names of problems; the wire's `code`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the table below says what each means")]
pub enum Code {
    MalformedJson,
    TruncatedBody,
    MalformedBody,
    MalformedHeader,
    Unauthenticated,
    KeyExpired,
    KeyRevoked,
    InsufficientScope,
    ModelForbidden,
    ForeignPage,
    NotFound,
    ModelNotFound,
    BatchNotFound,
    TaskNotFound,
    VersionNotFound,
    KeyNotFound,
    SourceNotFound,
    MethodNotAllowed,
    NotAcceptable,
    BodyTimeout,
    ModelExists,
    VersionTainted,
    VersionPruned,
    EventsPruned,
    NothingPending,
    TaskEnded,
    NoLiveVersion,
    NoParentVersion,
    Corrupt,
    AdminKeyFirst,
    LastAdminKey,
    TooManyKeys,
    NoBackupFolder,
    IdempotencyInFlight,
    PreconditionFailed,
    BodyTooLarge,
    UnsupportedMediaType,
    InvalidBody,
    InvalidQuery,
    InvalidSettings,
    NoEventAccepted,
    BatchRetracted,
    IdempotencyMismatch,
    RateLimited,
    Internal,
    NotAvailable,
    Busy,
    DatabaseBusy,
    StorageFull,
    DatabaseReadOnly,
    ShuttingDown,
    NotReady,
}

impl Code {
    /// Every code, for the contract test.
    pub const ALL: &[Self] = &[
        Self::MalformedJson,
        Self::TruncatedBody,
        Self::MalformedBody,
        Self::MalformedHeader,
        Self::Unauthenticated,
        Self::KeyExpired,
        Self::KeyRevoked,
        Self::InsufficientScope,
        Self::ModelForbidden,
        Self::ForeignPage,
        Self::NotFound,
        Self::ModelNotFound,
        Self::BatchNotFound,
        Self::TaskNotFound,
        Self::VersionNotFound,
        Self::KeyNotFound,
        Self::SourceNotFound,
        Self::MethodNotAllowed,
        Self::NotAcceptable,
        Self::BodyTimeout,
        Self::ModelExists,
        Self::VersionTainted,
        Self::VersionPruned,
        Self::EventsPruned,
        Self::NothingPending,
        Self::TaskEnded,
        Self::NoLiveVersion,
        Self::NoParentVersion,
        Self::Corrupt,
        Self::AdminKeyFirst,
        Self::LastAdminKey,
        Self::TooManyKeys,
        Self::NoBackupFolder,
        Self::IdempotencyInFlight,
        Self::PreconditionFailed,
        Self::BodyTooLarge,
        Self::UnsupportedMediaType,
        Self::InvalidBody,
        Self::InvalidQuery,
        Self::InvalidSettings,
        Self::NoEventAccepted,
        Self::BatchRetracted,
        Self::IdempotencyMismatch,
        Self::RateLimited,
        Self::Internal,
        Self::NotAvailable,
        Self::Busy,
        Self::DatabaseBusy,
        Self::StorageFull,
        Self::DatabaseReadOnly,
        Self::ShuttingDown,
        Self::NotReady,
    ];

    /// The table: name on the wire, status, title.
    #[must_use]
    pub fn row(self) -> (&'static str, StatusCode, &'static str) {
        use StatusCode as S;
        match self {
            Self::MalformedJson => ("malformed_json", S::BAD_REQUEST, "The body is not JSON"),
            Self::TruncatedBody => ("truncated_body", S::BAD_REQUEST, "The body ended too early"),
            Self::MalformedBody => ("malformed_body", S::BAD_REQUEST, "The body cannot be decoded"),
            Self::MalformedHeader => ("malformed_header", S::BAD_REQUEST, "A header has an unusable value"),
            Self::Unauthenticated => ("unauthenticated", S::UNAUTHORIZED, "A key is needed"),
            Self::KeyExpired => ("key_expired", S::UNAUTHORIZED, "The key has expired"),
            Self::KeyRevoked => ("key_revoked", S::UNAUTHORIZED, "The key was revoked"),
            Self::InsufficientScope => ("insufficient_scope", S::FORBIDDEN, "The key does not have the scope"),
            Self::ModelForbidden => ("model_forbidden", S::FORBIDDEN, "The key is for other models"),
            Self::ForeignPage => ("foreign_page", S::FORBIDDEN, "A page from elsewhere asks"),
            Self::NotFound => ("not_found", S::NOT_FOUND, "There is nothing at this path"),
            Self::ModelNotFound => ("model_not_found", S::NOT_FOUND, "There is no such model"),
            Self::BatchNotFound => ("batch_not_found", S::NOT_FOUND, "The model has no such batch"),
            Self::TaskNotFound => ("task_not_found", S::NOT_FOUND, "The model has no such task"),
            Self::VersionNotFound => ("version_not_found", S::NOT_FOUND, "The model has no such version"),
            Self::KeyNotFound => ("key_not_found", S::NOT_FOUND, "There is no such key"),
            Self::SourceNotFound => ("source_not_found", S::NOT_FOUND, "The model knows no such source"),
            Self::MethodNotAllowed => ("method_not_allowed", S::METHOD_NOT_ALLOWED, "The path has no such method"),
            Self::NotAcceptable => ("not_acceptable", S::NOT_ACCEPTABLE, "No acceptable representation"),
            Self::BodyTimeout => ("body_timeout", S::REQUEST_TIMEOUT, "The body did not arrive in time"),
            Self::ModelExists => ("model_exists", S::CONFLICT, "The model's name is taken"),
            Self::VersionTainted => ("version_tainted", S::CONFLICT, "The version learned what was retracted"),
            Self::VersionPruned => ("version_pruned", S::GONE, "The version's weights were not kept"),
            Self::EventsPruned => ("events_pruned", S::CONFLICT, "Events that are needed were not kept"),
            Self::NothingPending => ("nothing_pending", S::CONFLICT, "No event waits to be learned"),
            Self::TaskEnded => ("task_ended", S::CONFLICT, "The task has ended"),
            Self::NoLiveVersion => ("no_live_version", S::CONFLICT, "The model has no live version"),
            Self::NoParentVersion => ("no_parent_version", S::CONFLICT, "There is no version to roll back to"),
            Self::Corrupt => ("corrupt", S::CONFLICT, "What this needs is not what was stored"),
            Self::AdminKeyFirst => ("admin_key_first", S::CONFLICT, "There is no active admin key"),
            Self::LastAdminKey => ("last_admin_key", S::CONFLICT, "It is the last active admin key"),
            Self::TooManyKeys => ("too_many_keys", S::CONFLICT, "The server keeps no more keys"),
            Self::NoBackupFolder => ("no_backup_folder", S::CONFLICT, "The server keeps no backups"),
            Self::IdempotencyInFlight => {
                ("idempotency_in_flight", S::CONFLICT, "A request with this Idempotency-Key is being answered")
            }
            Self::PreconditionFailed => ("precondition_failed", S::PRECONDITION_FAILED, "The model has changed"),
            Self::BodyTooLarge => ("body_too_large", S::PAYLOAD_TOO_LARGE, "The body is too large"),
            Self::UnsupportedMediaType => {
                ("unsupported_media_type", S::UNSUPPORTED_MEDIA_TYPE, "The body's type is not supported")
            }
            Self::InvalidBody => ("invalid_body", S::UNPROCESSABLE_ENTITY, "The body is not what this call takes"),
            Self::InvalidQuery => ("invalid_query", S::UNPROCESSABLE_ENTITY, "A query parameter is unusable"),
            Self::InvalidSettings => ("invalid_settings", S::UNPROCESSABLE_ENTITY, "A setting is unusable"),
            Self::NoEventAccepted => ("no_event_accepted", S::UNPROCESSABLE_ENTITY, "No event was accepted"),
            Self::BatchRetracted => ("batch_retracted", S::CONFLICT, "The batch was retracted"),
            Self::IdempotencyMismatch => {
                ("idempotency_mismatch", S::UNPROCESSABLE_ENTITY, "The Idempotency-Key belongs to another request")
            }
            Self::RateLimited => ("rate_limited", S::TOO_MANY_REQUESTS, "The key asks too often"),
            Self::Internal => ("internal", S::INTERNAL_SERVER_ERROR, "Something went wrong here"),
            Self::NotAvailable => ("not_available", S::NOT_IMPLEMENTED, "Not available in this release"),
            Self::Busy => ("busy", S::SERVICE_UNAVAILABLE, "Too many requests of this kind at once"),
            Self::DatabaseBusy => {
                ("database_busy", S::SERVICE_UNAVAILABLE, "Other changes keep the database busy for too long")
            }
            Self::StorageFull => ("storage_full", S::INSUFFICIENT_STORAGE, "There is no room to store anything"),
            Self::DatabaseReadOnly => ("database_read_only", S::SERVICE_UNAVAILABLE, "The database cannot be written"),
            Self::NotReady => ("not_ready", S::SERVICE_UNAVAILABLE, "The server cannot serve everything yet"),
            Self::ShuttingDown => ("shutting_down", S::SERVICE_UNAVAILABLE, "The server is going down"),
        }
    }

    /// A problem of this kind.
    #[must_use]
    pub fn because(self, detail: impl Into<Cow<'static, str>>) -> Problem {
        Problem(Box::new(Contents {
            code: self,
            detail: detail.into(),
            errors: Vec::new(),
            extensions: Map::new(),
            headers: HeaderMap::new(),
            cause: None,
        }))
    }
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
            "type": format!("urn:headway:problem:{name}"),
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
    use std::collections::BTreeSet;

    #[test]
    fn every_code_has_a_name_of_its_own() {
        let names: BTreeSet<_> = Code::ALL.iter().map(|c| c.row().0).collect();
        assert_eq!(names.len(), Code::ALL.len());
    }

    #[test]
    fn an_internal_problem_keeps_its_cause_to_itself() {
        let context = RequestContext { request_id: "r1".to_owned(), path: "/v1/models".to_owned() };
        let problem = Problem::internal("disk on fire");
        let body = String::from_utf8(problem.answer(&context).into_stored().body).unwrap();
        assert!(!body.contains("fire") && body.contains("r1"), "{body}");
        assert_eq!(problem.cause(), Some("disk on fire"));
    }
}
