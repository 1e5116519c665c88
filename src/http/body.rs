//! JSON bodies: bounded in size and time, and refused with a pointer to what is wrong.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{FromRequest, Request};
use axum::http::HeaderMap;
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use super::AppState;
use super::object::Object;
use super::problem::{Code, InputError, Problem};

/// A JSON body, read and understood.
#[derive(Debug)]
pub(super) struct Json<T>(pub(super) T);

/// A JSON body whose request may be repeated.
#[derive(Debug)]
pub(super) struct JsonBody<T> {
    /// What it says.
    pub value: T,
    /// SHA-256 over query and bytes: what makes a repeated request the same.
    pub request_sha256: [u8; 32],
}

impl<T: DeserializeOwned + Send + 'static> FromRequest<Arc<AppState>> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, app: &Arc<AppState>) -> Result<Self, Problem> {
        parse_somewhere(read(request, app).await?).await.map(Self)
    }
}

impl<T: DeserializeOwned + Send + 'static> FromRequest<Arc<AppState>> for JsonBody<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, app: &Arc<AppState>) -> Result<Self, Problem> {
        let query = request.uri().query().unwrap_or_default().to_owned();
        let bytes = read(request, app).await?;
        let mut hasher = Sha256::new();
        hasher.update(query.as_bytes());
        hasher.update([0]);
        hasher.update(&bytes);
        Ok(Self { value: parse_somewhere(bytes).await?, request_sha256: hasher.finalize().into() })
    }
}

/// The whole of a JSON body, within `json_body_bytes`.
async fn read(request: Request, app: &AppState) -> Result<Vec<u8>, Problem> {
    if !is_json(request.headers()) {
        return Err(Code::UnsupportedMediaType.because("this call takes application/json"));
    }
    let limit = app.settings.json_body_bytes;
    refuse_declared_excess(request.headers(), limit)?;
    let mut chunks = std::pin::pin!(timed(request.into_body(), app.settings.body_idle_s));
    let mut bytes = Vec::new();
    while let Some(chunk) = chunks.next().await {
        let chunk = chunk?;
        if u64::try_from(bytes.len() + chunk.len()).unwrap_or(u64::MAX) > limit {
            return Err(too_large(limit));
        }
        bytes.extend_from_slice(&chunk);
    }
    Ok(bytes)
}

/// The chunks of a body, refusing one that stalls or breaks off.
pub(super) fn timed(body: Body, idle_s: f64) -> impl Stream<Item = Result<Bytes, Problem>> + Send {
    let idle = Duration::from_secs_f64(idle_s);
    futures_util::stream::unfold(Some(body.into_data_stream()), move |state| async move {
        let mut chunks = state?;
        match tokio::time::timeout(idle, chunks.next()).await {
            Ok(None) => None,
            Ok(Some(Ok(chunk))) => Some((Ok(chunk), Some(chunks))),
            Ok(Some(Err(e))) => Some((Err(Code::TruncatedBody.because(e.to_string())), None)),
            Err(_) => Some((Err(Code::BodyTimeout.because(format!("nothing came for {idle_s} s"))), None)),
        }
    })
}

/// Refuses a body whose declared length exceeds `limit` before any of it is read.
///
/// # Errors
/// When it does.
pub(super) fn refuse_declared_excess(headers: &HeaderMap, limit: u64) -> Result<(), Problem> {
    let declared = headers.get(CONTENT_LENGTH).and_then(|v| v.to_str().ok()).and_then(|v| v.parse::<u64>().ok());
    if declared.is_some_and(|length| length > limit) { Err(too_large(limit)) } else { Ok(()) }
}

/// A 413 that names the limit.
#[must_use]
pub(super) fn too_large(limit: u64) -> Problem {
    Code::BodyTooLarge.because(format!("at most {limit} bytes are taken here"))
}

/// The media type, lowercase, without parameters.
#[must_use]
pub(super) fn media_type(headers: &HeaderMap) -> Option<String> {
    let value = headers.get(CONTENT_TYPE)?.to_str().ok()?;
    Some(value.split(';').next().unwrap_or_default().trim().to_ascii_lowercase())
}

fn is_json(headers: &HeaderMap) -> bool {
    media_type(headers).is_some_and(|media| {
        media == "application/json" || (media.starts_with("application/") && media.ends_with("+json"))
    })
}

/// Long bodies are parsed off the async runtime.
async fn parse_somewhere<T: DeserializeOwned + Send + 'static>(bytes: Vec<u8>) -> Result<T, Problem> {
    const INLINE_BYTES: usize = 64 * 1024;
    if bytes.len() <= INLINE_BYTES {
        return parse(&bytes);
    }
    tokio::task::spawn_blocking(move || parse(&bytes)).await.map_err(Problem::internal)?
}

/// Keeping track of where in the body something is takes longer than to read it: done only once something is wrong.
fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    match serde_json::from_slice(bytes) {
        Ok(Object(value)) => Ok(value),
        Err(_) => explain(bytes),
    }
}

/// As [`parse`], and what is wrong is pointed at.
fn explain<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let Object(value) = serde_path_to_error::deserialize(&mut deserializer).map_err(|e| {
        let pointer = pointer(e.path());
        refusal(&e.into_inner(), pointer)
    })?;
    deserializer.end().map_err(|e| refusal(&e, String::new()))?;
    Ok(value)
}

fn refusal(error: &serde_json::Error, pointer: String) -> Problem {
    if error.is_data() || is_out_of_range(error) {
        let detail = error.to_string();
        return Code::InvalidBody.because(detail.clone()).with_error(InputError::at(pointer, "invalid_value", detail));
    }
    Code::MalformedJson.because(error.to_string())
}

/// Whether a number is well formed and greater than any 64-bit float, which `serde_json` takes for a fault of syntax.
fn is_out_of_range(error: &serde_json::Error) -> bool {
    error.to_string().starts_with("number out of range")
}

fn pointer(path: &serde_path_to_error::Path) -> String {
    use serde_path_to_error::Segment;
    let token = |segment: &Segment| match segment {
        Segment::Seq { index } => format!("/{index}"),
        Segment::Map { key } => format!("/{}", key.replace('~', "~0").replace('/', "~1")),
        Segment::Enum { .. } | Segment::Unknown => String::new(),
    };
    path.iter().map(token).collect::<Vec<_>>().concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;
    use serde_json::json;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Example {
        #[expect(dead_code, reason = "only parsed")]
        windows: Vec<Vec<f64>>,
    }

    #[test]
    fn malformed_and_wrong_are_told_apart_and_the_wrong_is_pointed_at() {
        let code = |body: &str| parse::<Example>(body.as_bytes()).unwrap_err().code();
        assert_eq!(code("{"), Code::MalformedJson);
        assert_eq!(code(""), Code::MalformedJson);
        assert_eq!(code(r#"{"windows": []} x"#), Code::MalformedJson);
        assert_eq!(code(r#"{"windows": [[NaN]]}"#), Code::MalformedJson);
        assert_eq!(code(r#"{"windows": [], "more": 1}"#), Code::InvalidBody);
        assert_eq!(code("[[]]"), Code::InvalidBody);
        let context = super::super::problem::RequestContext { request_id: String::new(), path: String::new() };
        for wrong in [r#"{"windows": [[1], [2, "x"]]}"#, r#"{"windows": [[1], [2, -1e999]]}"#] {
            let problem = parse::<Example>(wrong.as_bytes()).unwrap_err();
            assert_eq!(problem.code(), Code::InvalidBody);
            let body: serde_json::Value = serde_json::from_slice(&problem.answer(&context).into_stored().body).unwrap();
            assert_eq!(body["errors"][0]["pointer"], json!("/windows/1/1"));
        }
    }
}
