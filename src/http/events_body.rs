//! Bodies of events, to be stored or only looked at: their type, their bytes, and what may be wrong with them.

use std::io::{self, ErrorKind};

use axum::body::Body;
use axum::extract::Request;
use axum::http::header::{CONTENT_ENCODING, CONTENT_TYPE, HeaderMap, HeaderName};

use super::AppState;
use super::body::{Pace, refuse_declared_excess, timed, too_large};
use super::problem::{Code, InputError, Problem};
use crate::formats::{Encoding, Format, FormatError};
use crate::ingest::{IngestError, Interrupted, OptionError, SpoolError, Spooled, spool};

/// What the headers say the body is.
///
/// # Errors
/// When it is nothing that events are taken from.
pub(super) fn kind(headers: &HeaderMap) -> Result<(Format, Encoding), Problem> {
    let text = |name: HeaderName| match headers.get(&name).map(|value| value.to_str()) {
        None => Ok(None),
        Some(Ok(text)) => Ok(Some(text)),
        Some(Err(_)) => Err(Code::MalformedHeader.because(format!("{name} is not ASCII"))),
    };
    let format = Format::from_content_type(text(CONTENT_TYPE)?.unwrap_or_default()).map_err(format_problem)?;
    let encoding = Encoding::from_content_encoding(text(CONTENT_ENCODING)?).map_err(format_problem)?;
    Ok((format, encoding))
}

/// The whole body, in a temporary file.
///
/// # Errors
/// When it is too large, stalls or breaks off.
pub(super) async fn take_body(app: &AppState, http: Request<Body>) -> Result<Spooled, Problem> {
    take_body_within(app, http, app.ingest.max_body_bytes).await
}

/// The whole of a body of at most `limit` bytes, in a temporary file.
///
/// # Errors
/// When it is too large, stalls or breaks off.
pub(super) async fn take_body_within(app: &AppState, http: Request<Body>, limit: u64) -> Result<Spooled, Problem> {
    refuse_declared_excess(http.headers(), limit)?;
    let body = timed(http.into_body(), Pace::of(&app.settings));
    spool(body, &app.ingest, limit).await.map_err(|interrupted| match interrupted {
        Interrupted::Body(problem) => problem,
        Interrupted::Spool(SpoolError::TooLarge { max_bytes }) => too_large(max_bytes),
        Interrupted::Spool(SpoolError::Io(error)) if is_full(&error) => Problem::full(error),
        Interrupted::Spool(error @ SpoolError::Io(_)) => Problem::internal(error),
    })
}

/// Whether a file cannot be written because there is no room, or no more may be taken.
fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge)
}

/// A 422 that names the option.
pub(super) fn option_problem(error: &OptionError) -> Problem {
    Code::InvalidQuery.because(error.to_string()).with_error(InputError::parameter(
        error.name,
        error.code,
        error.detail.clone(),
    ))
}

/// Why nothing of a body was taken.
pub(super) fn ingest_problem(error: IngestError) -> Problem {
    match error {
        IngestError::Option(error) => option_problem(&error),
        IngestError::Format(error) => format_problem(error),
        IngestError::Store(error) => error.into(),
        IngestError::TooManySteps { .. } => Code::BodyTooLarge.because(error.to_string()),
        IngestError::Panicked => Problem::internal(error),
    }
}

fn format_problem(error: FormatError) -> Problem {
    let code = match &error {
        FormatError::Truncated { .. } => Code::TruncatedBody,
        FormatError::Malformed { .. } => Code::MalformedBody,
        FormatError::Invalid { .. } => Code::InvalidBody,
        FormatError::TooLarge { .. } => Code::BodyTooLarge,
        FormatError::Unsupported { .. } => Code::UnsupportedMediaType,
        FormatError::Io(_) | FormatError::Stopped => return Problem::internal(error),
    };
    let problem = code.because(error.to_string());
    match error.place() {
        Some(place) => problem.with_error(InputError::within(place, error.code(), error.to_string())),
        None => problem,
    }
}
