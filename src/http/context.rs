//! The outermost layer: request ids, the log line, the metrics, and the rendering of problems.

use std::hash::{BuildHasher, RandomState};
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use axum::extract::{FromRequestParts, MatchedPath, Request, State};
use axum::http::header::{HeaderMap, HeaderName, HeaderValue};
use axum::http::request::Parts;
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tracing::instrument::Instrumented;
use tracing::{Instrument, Span};

use super::AppState;
use super::accept::acceptable;
use super::gate::{Admitted, Need, limits};
use super::path::model_named;
use super::predict;
use super::problem::{Problem, RequestContext};
use super::refusals::Refusals;
use super::route::Needs;
use super::shield::shield;
use super::v2;
use crate::access::{Class, Standing};

/// Routes that may be called thousands of times a second, or by whoever has no key: unless something is wrong, their log lines are
/// for `debug`.
const OFTEN: [&str; 8] = [
    predict::ROUTE,
    "/v1/models/{model}/simulate",
    "/v2/models/{model}/infer",
    "/v2/models/{model}/versions/{version}/infer",
    "/healthz",
    "/readyz",
    "/v2/health/live",
    "/v2/health/ready",
];

pub(super) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

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
    /// The client's, where it is usable, else one of ours.
    fn of(&self, headers: &HeaderMap) -> HeaderValue {
        let given = headers.get(REQUEST_ID).filter(|id| is_sane(id.as_bytes()));
        given.cloned().unwrap_or_else(|| self.made())
    }

    fn made(&self) -> HeaderValue {
        let mut id = [0; 8 + 1 + 16];
        let mut rest = &mut id[..];
        write!(rest, "{:08x}-{:x}", self.prefix, self.next.fetch_add(1, Ordering::Relaxed)).expect("it fits");
        let unused = rest.len();
        HeaderValue::from_bytes(&id[..id.len() - unused]).expect("request ids are ASCII")
    }
}

/// Whether a client's id for its request is one to take.
pub(super) fn is_sane(id: &[u8]) -> bool {
    (1..=128).contains(&id.len()) && id.iter().all(|&b| b.is_ascii_alphanumeric() || b"-_.:".contains(&b))
}

/// What the outermost layer knows.
#[derive(Debug, Clone)]
pub(super) struct Around {
    pub(super) app: Arc<AppState>,
    pub(super) needs: Arc<Needs>,
}

/// The router's outermost layer: an [`Observation`] around everything it answers, and the gate before it.
pub(super) async fn observe(State(around): State<Around>, request: Request, next: Next) -> Response {
    let Around { app, needs } = &around;
    let matched = request.extensions().get::<MatchedPath>().cloned();
    let route = matched.as_ref().map_or("unmatched", MatchedPath::as_str);
    let path = request.uri().path().to_owned();
    let observation = Observation::begin(app, route, request.method(), &path, request.headers());
    let need = needs.of(route, request.method());
    let (mut parts, body) = request.into_parts();
    parts.extensions.insert(observation.context());
    match enter(app, need, route, &mut parts).await {
        Ok(standing) => {
            let answer = observation.within(next.run(Request::from_parts(parts, body))).await;
            let mut answer = observation.end(answer);
            // Predictions are many: they are told of their limit once it is reached.
            if let Some(standing) = standing.filter(|standing| standing.policy.class == Class::Default) {
                answer.headers_mut().extend(limits(&standing));
            }
            answer
        }
        Err(problem) => observation.end(problem.into_response()),
    }
}

/// Lets a request in to its handler, which is told who sent it.
async fn enter(app: &AppState, need: Need, route: &str, parts: &mut Parts) -> Result<Option<Standing>, Problem> {
    let model = if route.contains("{model}") { Some(model_named(parts).await) } else { None };
    let Admitted { caller, standing } = app.gate.admit(&parts.method, &parts.headers, need, model.as_deref())?;
    parts.extensions.insert(caller);
    acceptable(&parts.headers, route)?;
    Ok(standing)
}

/// What is to be told of a request once it is answered. Makes nothing that only a log line or a problem would need before it
/// is known that there is one.
#[derive(Debug)]
pub(super) struct Observation<'a> {
    app: &'a AppState,
    route: &'a str,
    path: &'a str,
    method: Method,
    request_id: HeaderValue,
    began: Instant,
    /// None while the request is one of very many and `debug` is off.
    span: Span,
}

impl<'a> Observation<'a> {
    /// Names the request, and looks at the clock.
    pub(super) fn begin(
        app: &'a AppState,
        route: &'a str,
        method: &Method,
        path: &'a str,
        headers: &HeaderMap,
    ) -> Self {
        let (method, request_id) = (method.clone(), app.request_ids.of(headers));
        let mut begun = Self { app, route, path, method, request_id, began: Instant::now(), span: Span::none() };
        if !OFTEN.contains(&route) || tracing::enabled!(tracing::Level::DEBUG) {
            begun.span = begun.make_span();
        }
        begun
    }

    /// `answering`, whose log lines say which request they belong to.
    pub(super) fn within<F>(&self, answering: F) -> Instrumented<F> {
        answering.instrument(self.span.clone())
    }

    /// Renders the problem that `answer` may be, names the request in it, counts it and logs it.
    pub(super) fn end(mut self, mut answer: Response) -> Response {
        let well = answer.status().is_success();
        if !well && self.span.is_none() {
            self.span = self.make_span();
        }
        if let Some(problem) = answer.extensions_mut().remove::<Problem>() {
            if let Some(cause) = problem.cause() {
                self.span.in_scope(|| tracing::error!(cause, "request failed"));
            }
            answer = match self.path {
                path if v2::is_under(path) => v2::refused(&problem, &self.context()),
                _ => problem.answer(&self.context()),
            }
            .into_response();
        }
        let (status, elapsed_s) = (answer.status(), self.began.elapsed().as_secs_f64());
        self.app.metrics.http_request(self.route, counted(&self.method), status.as_u16(), elapsed_s);
        self.log(status, elapsed_s);
        let headers = answer.headers_mut();
        headers.insert(REQUEST_ID, self.request_id);
        shield(headers, self.app.settings.tls.is_on());
        answer
    }

    fn log(&self, status: StatusCode, elapsed_s: f64) {
        let _request = self.span.enter();
        let code = status.as_u16();
        if Refusals::is_one(status) {
            if let Some(untold) = self.app.refusals.note() {
                tracing::info!(status = code, elapsed_s, untold, "refused");
            } else {
                tracing::debug!(status = code, elapsed_s, "refused");
            }
        } else if OFTEN.contains(&self.route) && status.is_success() {
            tracing::debug!(status = code, elapsed_s, "answered");
        } else {
            tracing::info!(status = code, elapsed_s, "answered");
        }
    }

    fn context(&self) -> RequestContext {
        RequestContext { request_id: self.request_id().to_owned(), path: self.path.to_owned() }
    }

    fn request_id(&self) -> &str {
        self.request_id.to_str().expect("request ids are ASCII")
    }

    fn make_span(&self) -> Span {
        tracing::info_span!("request", request_id = self.request_id(), method = %self.method, path = self.path)
    }
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
        assert!(is_sane(made.as_bytes()));
    }
}
