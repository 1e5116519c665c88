//! The outermost layer: request ids, the log line, the metrics, and the rendering of problems.

use std::hash::{BuildHasher, RandomState};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use axum::extract::{FromRequestParts, MatchedPath, Request, State};
use axum::http::Method;
use axum::http::header::{ACCEPT, HeaderMap, HeaderName, HeaderValue};
use axum::http::request::Parts;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tracing::{Instrument, Span};

use super::AppState;
use super::problem::{Code, Problem, RequestContext};

/// Routes that may be called thousands of times a second: unless something is wrong, their log lines are for `debug`.
const OFTEN: [&str; 2] = ["/v1/models/{model}/predict", "/v1/models/{model}/simulate"];

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

impl<S: Sync> FromRequestParts<S> for RequestContext {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        parts.extensions.get().cloned().ok_or_else(|| Problem::internal("a route outside the outermost layer"))
    }
}

/// Makes request ids: eight random digits of this process and a count.
#[derive(Debug)]
pub struct RequestIds {
    prefix: u32,
    next: AtomicU64,
}

impl Default for RequestIds {
    fn default() -> Self {
        let bytes = RandomState::new().hash_one(0_u8).to_le_bytes();
        Self { prefix: u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]), next: AtomicU64::new(1) }
    }
}

impl RequestIds {
    fn of(&self, headers: &HeaderMap) -> String {
        let given = headers.get(REQUEST_ID).and_then(|value| value.to_str().ok()).filter(|id| is_sane(id));
        match given {
            Some(id) => id.to_owned(),
            None => format!("{:08x}-{:x}", self.prefix, self.next.fetch_add(1, Ordering::Relaxed)),
        }
    }
}

fn is_sane(id: &str) -> bool {
    (1..=128).contains(&id.len()) && id.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.:".contains(&b))
}

/// The outermost layer.
pub(super) async fn observe(State(app): State<Arc<AppState>>, mut request: Request, next: Next) -> Response {
    let began = Instant::now();
    let context =
        RequestContext { request_id: app.request_ids.of(request.headers()), path: request.uri().path().to_owned() };
    let method = request.method().clone();
    let matched = request.extensions().get::<MatchedPath>().cloned();
    let route = matched.as_ref().map_or("unmatched", MatchedPath::as_str);
    request.extensions_mut().insert(context.clone());
    let often = OFTEN.contains(&route);
    let span = || tracing::info_span!("request", request_id = context.request_id, %method, path = context.path);
    let told = if often && !tracing::enabled!(tracing::Level::DEBUG) { Span::none() } else { span() };
    let response = match acceptable(request.headers(), route) {
        Ok(()) => next.run(request).instrument(told.clone()).await,
        Err(problem) => problem.into_response(),
    };
    let well = response.status().is_success();
    let told = if told.is_none() && !well { span() } else { told };
    let mut response = render(response, &context, &told);
    let id = HeaderValue::try_from(&context.request_id).expect("request ids are ASCII");
    response.headers_mut().insert(REQUEST_ID, id);
    let (status, elapsed_s) = (response.status().as_u16(), began.elapsed().as_secs_f64());
    app.metrics.http_request(route, counted(&method), status, elapsed_s);
    if often && well {
        told.in_scope(|| tracing::debug!(status, elapsed_s, "answered"));
    } else {
        told.in_scope(|| tracing::info!(status, elapsed_s, "answered"));
    }
    response
}

/// A method as the metrics know it: clients may make up others, and each would be counted for ever.
fn counted(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::PUT => "PUT",
        Method::PATCH => "PATCH",
        Method::DELETE => "DELETE",
        Method::OPTIONS => "OPTIONS",
        _ => "other",
    }
}

fn render(mut response: Response, context: &RequestContext, span: &tracing::Span) -> Response {
    let Some(problem) = response.extensions_mut().remove::<Problem>() else { return response };
    if let Some(cause) = problem.cause() {
        span.in_scope(|| tracing::error!(cause, "request failed"));
    }
    problem.answer(context).into_response()
}

/// Whether the client takes what the route sends.
fn acceptable(headers: &HeaderMap, route: &str) -> Result<(), Problem> {
    let offers: &[&str] = match route {
        "/metrics" => &["text/plain"],
        route if route.ends_with("/progress") => &["text/event-stream"],
        route if route.ends_with("/artifact") => return Ok(()),
        _ => &["application/json", "application/problem+json"],
    };
    let mut accepts =
        headers.get_all(ACCEPT).iter().filter_map(|v| v.to_str().ok()).flat_map(|v| v.split(',')).peekable();
    if accepts.peek().is_none() || accepts.any(|range| offers.iter().any(|offer| takes(range, offer))) {
        return Ok(());
    }
    Err(Code::NotAcceptable.because(format!("this call answers {}", offers[0])))
}

fn takes(range: &str, offer: &str) -> bool {
    let mut parts = range.split(';').map(str::trim);
    let media = parts.next().unwrap_or_default();
    let refused = parts.any(|p| p.strip_prefix("q=").is_some_and(|q| q.parse() == Ok(0.0)));
    let family = offer.split('/').next().unwrap_or_default();
    !refused && (media == "*/*" || media.eq_ignore_ascii_case(offer) || media == format!("{family}/*"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(name: HeaderName, value: &'static str) -> HeaderMap {
        HeaderMap::from_iter([(name, HeaderValue::from_static(value))])
    }

    #[test]
    fn a_sane_request_id_is_kept_and_another_replaced() {
        let ids = RequestIds::default();
        assert_eq!(ids.of(&headers(REQUEST_ID, "trace-7.a:b_c")), "trace-7.a:b_c");
        let made = ids.of(&headers(REQUEST_ID, "two words"));
        assert_ne!(made, ids.of(&HeaderMap::new()));
        assert!(is_sane(&made));
    }

    #[test]
    fn accept_is_honoured_with_wildcards_and_refusals() {
        let ok = |accept| acceptable(&headers(ACCEPT, accept), "/v1/models").is_ok();
        assert!(ok("*/*") && ok("application/*") && ok("text/html, application/json;q=0.5"));
        assert!(!ok("text/html") && !ok("application/json;q=0"));
        assert!(acceptable(&headers(ACCEPT, "text/event-stream"), "/v1/x/progress").is_ok());
        assert!(acceptable(&HeaderMap::new(), "/metrics").is_ok());
    }
}
