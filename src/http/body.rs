//! JSON bodies: bounded in size and time, and refused with a pointer to what is wrong.

use std::fmt::Display;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::{Body, HttpBody};
use axum::extract::{FromRequest, Request};
use axum::http::HeaderMap;
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use bytes::Bytes;
use futures_util::Stream;
use http_body_util::BodyExt;
use serde::de::{DeserializeOwned, IgnoredAny};
use sha2::{Digest, Sha256};
use tokio::sync::OwnedSemaphorePermit;

use super::object::Object;
use super::problem::{Code, InputError, Problem};
use super::{AppState, ServerSettings};
use crate::formats::excerpt;

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
        let (parts, body) = request.into_parts();
        Self::from_body(&parts.headers, body, app).await
    }
}

impl<T: DeserializeOwned + Send + 'static> Json<T> {
    /// Reads and understands a body that came with these headers.
    ///
    /// # Errors
    /// When it is too large, stalls, breaks off, or is not what it should be.
    pub(super) async fn from_body<B>(headers: &HeaderMap, body: B, app: &AppState) -> Result<Self, Problem>
    where
        B: HttpBody<Data = Bytes>,
        B::Error: Display,
    {
        let body = read(headers, body, app).await?;
        parse_somewhere(body).await.map(Self)
    }
}

impl<T: DeserializeOwned + Send + 'static> FromRequest<Arc<AppState>> for JsonBody<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, app: &Arc<AppState>) -> Result<Self, Problem> {
        let (parts, body) = request.into_parts();
        let body = read(&parts.headers, body, app).await?;
        let mut hasher = Sha256::new();
        hasher.update(parts.uri.query().unwrap_or_default().as_bytes());
        hasher.update([0]);
        hasher.update(&body.bytes);
        Ok(Self { value: parse_somewhere(body).await?, request_sha256: hasher.finalize().into() })
    }
}

/// A body in memory, and the room it takes of what all of them may.
pub(super) struct Held {
    pub(super) bytes: Bytes,
    _room: Option<OwnedSemaphorePermit>,
}

impl Held {
    /// These bytes, with room for what they take.
    ///
    /// # Errors
    /// 503 when there is none.
    pub(super) fn of(bytes: Vec<u8>, app: &AppState) -> Result<Self, Problem> {
        let room = room(app, bytes.len())?;
        Ok(Self { bytes: bytes.into(), _room: Some(room) })
    }
}

/// Room for so many more bytes of bodies.
fn room(app: &AppState, bytes: usize) -> Result<OwnedSemaphorePermit, Problem> {
    let full = "as many bytes of bodies as the server keeps at once are there";
    u32::try_from(bytes)
        .ok()
        .and_then(|bytes| Arc::clone(&app.body_room).try_acquire_many_owned(bytes).ok())
        .ok_or_else(|| Problem::busy(Code::Busy, full))
}

/// The whole of a JSON body, within `json_body_bytes`; not copied when it came in one piece.
async fn read<B>(headers: &HeaderMap, body: B, app: &AppState) -> Result<Held, Problem>
where
    B: HttpBody<Data = Bytes>,
    B::Error: Display,
{
    if !says_json(headers) {
        return Err(Code::UnsupportedMediaType.because("this call takes application/json"));
    }
    read_whole(headers, body, app).await
}

/// The whole of a body of whatever type, within `json_body_bytes`; not copied when it came in one piece.
///
/// # Errors
/// When it is too large, stalls or breaks off.
pub(super) async fn read_whole<B>(headers: &HeaderMap, body: B, app: &AppState) -> Result<Held, Problem>
where
    B: HttpBody<Data = Bytes>,
    B::Error: Display,
{
    let (limit, mut pace) = (app.settings.json_body_bytes, Pace::of(&app.settings));
    refuse_declared_excess(headers, limit)?;
    let within = |bytes: usize| if bytes as u64 > limit { Err(too_large(limit)) } else { Ok(()) };
    let mut body = std::pin::pin!(body);
    let first = next_chunk(body.as_mut(), &mut pace).await?.unwrap_or_default();
    within(first.len())?;
    let Some(mut chunk) = next_chunk(body.as_mut(), &mut pace).await? else {
        return Ok(Held { bytes: first, _room: None });
    };
    let mut taken = room(app, first.len())?;
    let mut bytes = Vec::from(first);
    loop {
        within(bytes.len() + chunk.len())?;
        taken.merge(room(app, chunk.len())?);
        bytes.extend_from_slice(&chunk);
        match next_chunk(body.as_mut(), &mut pace).await? {
            Some(next) => chunk = next,
            None => return Ok(Held { bytes: bytes.into(), _room: Some(taken) }),
        }
    }
}

/// How slowly a body may come.
#[derive(Debug)]
pub(super) struct Pace {
    idle_s: f64,
    bytes_per_s: f64,
    began: Option<Instant>,
    bytes: u64,
}

impl Pace {
    /// Of a body of which nothing has come yet.
    pub(super) fn of(settings: &ServerSettings) -> Self {
        Self { idle_s: settings.body_idle_s, bytes_per_s: settings.body_bytes_per_s, began: None, bytes: 0 }
    }

    /// How long the next chunk may take.
    fn left(&mut self) -> Duration {
        let left_s = match self.began {
            None => {
                self.began = Some(Instant::now());
                self.idle_s
            }
            Some(began) => {
                let behind_s = began.elapsed().as_secs_f64() - self.bytes as f64 / self.bytes_per_s;
                (self.idle_s - behind_s).clamp(0.0, self.idle_s)
            }
        };
        Duration::from_secs_f64(left_s)
    }

    fn too_slow(&self) -> Problem {
        Code::BodyTimeout.because(format!(
            "nothing came for {} s, or less than {} bytes/s for longer",
            self.idle_s, self.bytes_per_s
        ))
    }
}

/// The next chunk of a body, refusing one that stalls, dawdles or breaks off.
async fn next_chunk<B>(mut body: Pin<&mut B>, pace: &mut Pace) -> Result<Option<Bytes>, Problem>
where
    B: HttpBody<Data = Bytes>,
    B::Error: Display,
{
    // A body whose length was told has ended with its last byte: nothing more is waited for.
    while !body.is_end_stream() {
        match tokio::time::timeout(pace.left(), body.frame()).await {
            Ok(None) => break,
            Ok(Some(Ok(frame))) => {
                if let Ok(chunk) = frame.into_data() {
                    pace.bytes += chunk.len() as u64;
                    return Ok(Some(chunk));
                }
            }
            Ok(Some(Err(e))) => return Err(Code::TruncatedBody.because(e.to_string())),
            Err(_) => return Err(pace.too_slow()),
        }
    }
    Ok(None)
}

/// The chunks of a body, refusing one that stalls, dawdles or breaks off.
pub(super) fn timed(body: Body, pace: Pace) -> impl Stream<Item = Result<Bytes, Problem>> + Send {
    futures_util::stream::try_unfold((body, pace), |(mut body, mut pace)| async move {
        Ok(next_chunk(Pin::new(&mut body), &mut pace).await?.map(|chunk| (chunk, (body, pace))))
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

fn says_json(headers: &HeaderMap) -> bool {
    media_type(headers).is_some_and(|media| {
        media == "application/json" || (media.starts_with("application/") && media.ends_with("+json"))
    })
}

/// Long bodies are parsed off the async runtime.
async fn parse_somewhere<T: DeserializeOwned + Send + 'static>(body: Held) -> Result<T, Problem> {
    const INLINE_BYTES: usize = 64 * 1024;
    if body.bytes.len() <= INLINE_BYTES {
        return parse(&body.bytes);
    }
    tokio::task::spawn_blocking(move || parse(&body.bytes)).await.map_err(Problem::internal)?
}

/// Keeping track of where in the body something is takes longer than to read it: done only once something is wrong.
pub(super) fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
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
        refusal(&e.into_inner(), pointer, bytes)
    })?;
    deserializer.end().map_err(|e| refusal(&e, String::new(), bytes))?;
    Ok(value)
}

fn refusal(error: &serde_json::Error, pointer: String, bytes: &[u8]) -> Problem {
    if error.is_data() || is_json(bytes) {
        let detail = excerpt(error);
        return Code::InvalidBody.because(detail.clone()).with_error(InputError::at(pointer, "invalid_value", detail));
    }
    Code::MalformedJson.because(excerpt(error))
}

/// Whether a body is JSON, whatever it says. `serde_json` also calls a fault of syntax what is none: a number greater than any
/// 64-bit float, a number in place of a name, more nesting than it takes.
fn is_json(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).is_ok_and(|text| serde_json::from_str::<IgnoredAny>(text).is_ok())
}

fn pointer(path: &serde_path_to_error::Path) -> String {
    use serde_path_to_error::Segment;
    let token = |segment: &Segment| match segment {
        Segment::Seq { index } => format!("/{index}"),
        Segment::Map { key } => format!("/{}", key.replace('~', "~0").replace('/', "~1")),
        Segment::Enum { .. } | Segment::Unknown => String::new(),
    };
    excerpt(&path.iter().map(token).collect::<Vec<_>>().concat())
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
        let method = |body: &[u8]| parse::<std::collections::BTreeMap<String, crate::consolidation::Method>>(body);
        assert_eq!(method(b"{\"method\": 50}").unwrap_err().code(), Code::InvalidBody);
        assert_eq!(method(b"{\"method\": \"\xff\"}").unwrap_err().code(), Code::MalformedJson);
        let context = super::super::problem::RequestContext { request_id: String::new(), path: String::new() };
        for wrong in [r#"{"windows": [[1], [2, "x"]]}"#, r#"{"windows": [[1], [2, -1e999]]}"#] {
            let problem = parse::<Example>(wrong.as_bytes()).unwrap_err();
            assert_eq!(problem.code(), Code::InvalidBody);
            let body: serde_json::Value = serde_json::from_slice(&problem.answer(&context).into_stored().body).unwrap();
            assert_eq!(body["errors"][0]["pointer"], json!("/windows/1/1"));
        }
    }
}
