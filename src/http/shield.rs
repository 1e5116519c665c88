//! What every answer tells a browser to leave alone, and which pages' scripts may read answers.

use axum::http::Method;
use axum::http::header::{
    AUTHORIZATION, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, HeaderMap, HeaderName,
    HeaderValue, IF_MATCH, LOCATION, RETRY_AFTER, STRICT_TRANSPORT_SECURITY, X_CONTENT_TYPE_OPTIONS,
};
use tower_http::cors::CorsLayer;

/// Adds the headers, but for those that a handler has set: answers are data, which no browser is to run, frame, guess the type
/// of or keep.
pub(super) fn shield(headers: &mut HeaderMap, encrypted: bool) {
    const EVERY: [(HeaderName, HeaderValue); 3] = [
        (X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
        (CONTENT_SECURITY_POLICY, HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'")),
        (CACHE_CONTROL, HeaderValue::from_static("no-store")),
    ];
    for (name, value) in EVERY {
        headers.entry(name).or_insert(value);
    }
    if encrypted {
        headers.insert(STRICT_TRANSPORT_SECURITY, HeaderValue::from_static("max-age=31536000"));
    }
}

/// Lets the scripts of pages from these origins use the interface; `None` for nobody's, and the browser is not told that there
/// is anything.
pub(super) fn cors(origins: &[String]) -> Option<CorsLayer> {
    if origins.is_empty() {
        return None;
    }
    let origins: Vec<HeaderValue> = origins.iter().filter_map(|origin| HeaderValue::from_str(origin).ok()).collect();
    let own = ["x-request-id", "ratelimit", "ratelimit-policy", "idempotency-replayed"].map(HeaderName::from_static);
    let sent = [AUTHORIZATION, CONTENT_TYPE, CONTENT_ENCODING, IF_MATCH, HeaderName::from_static("idempotency-key")];
    let layer = CorsLayer::new()
        .allow_origin(origins)
        .allow_methods([Method::GET, Method::POST, Method::PATCH, Method::DELETE])
        .allow_headers(sent)
        .expose_headers([ETAG, LOCATION, RETRY_AFTER].into_iter().chain(own).collect::<Vec<_>>());
    Some(layer)
}
