//! The interface as what answers a connection's requests: the router, and a short way past it.
//!
//! The router finds its way among all routes and boxes what it finds several times over, which costs more than reading and
//! writing a small prediction. That one call, made thousands of times a second, is recognised here; everything about it that a
//! client can see is the same either way.

use std::fmt::Display;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, HttpBody};
use axum::http::header::{ACCEPT, HeaderMap, ORIGIN};
use axum::http::request::Parts;
use axum::http::{Method, Request};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::FutureExt;
use tower::ServiceExt;

use super::accept::acceptable;
use super::body::Json;
use super::context::Observation;
use super::path::ServedAt;
use super::table::{FIGURES, Form};
use super::{AppState, panicked, predict, router};

/// The whole interface.
#[derive(Debug, Clone)]
pub struct Interface {
    app: Arc<AppState>,
    router: Router,
}

impl Interface {
    /// The interface to `app`.
    #[must_use]
    pub fn new(app: Arc<AppState>) -> Self {
        Self { router: router(Arc::clone(&app)), app }
    }

    /// The answer to one request.
    pub async fn answer<B>(&self, request: Request<B>) -> Response
    where
        B: HttpBody<Data = Bytes> + Send + 'static,
        B::Error: Display + Into<axum::BoxError>,
    {
        let (parts, body) = request.into_parts();
        // What a browser wants to know of pages elsewhere, the router says.
        let from_page = !self.app.settings.cors_origins.is_empty() && parts.headers.contains_key(ORIGIN);
        if let Some(model) = predicted(&parts).filter(|_| !from_page && !wants_table(&parts.headers)) {
            return self.predict(model, &parts, body).await;
        }
        let Ok(answer) = self.router.clone().oneshot(Request::from_parts(parts, Body::new(body))).await;
        answer
    }

    async fn predict<B>(&self, model: &str, parts: &Parts, body: B) -> Response
    where
        B: HttpBody<Data = Bytes>,
        B::Error: Display,
    {
        let Parts { method, uri, headers, .. } = parts;
        let observation = Observation::begin(&self.app, predict::ROUTE, method, uri.path(), headers);
        let answering = async {
            self.app.gate.pass(headers, predict::NEED, Some(model))?;
            acceptable(headers, predict::ROUTE)?;
            let model = ServedAt::find(&self.app, model.to_owned()).await?;
            let Json(wish) = Json::from_body(headers, body, &self.app).await?;
            predict::answer(&self.app, &model, wish).await
        };
        let answered = AssertUnwindSafe(observation.within(answering)).catch_unwind().await;
        observation.end(answered.unwrap_or_else(|payload| Err(panicked(&*payload))).into_response())
    }
}

/// Whether predictions are asked for in another form than JSON, which nearly nobody does.
fn wants_table(headers: &HeaderMap) -> bool {
    match headers.get(ACCEPT) {
        None => false,
        Some(accept) if accept == "*/*" || accept == "application/json" => false,
        Some(_) => Form::accepted(headers, FIGURES) != Form::Json,
    }
}

/// The model that a prediction is asked of, where its name is written plainly.
fn predicted(parts: &Parts) -> Option<&str> {
    let (before, after) = predict::ROUTE.split_once("{model}")?;
    let model = parts.uri.path().strip_prefix(before)?.strip_suffix(after)?;
    (parts.method == Method::POST && !model.is_empty() && !model.contains(['/', '%'])).then_some(model)
}
