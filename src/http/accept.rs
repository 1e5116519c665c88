//! `Accept`: what a route sends, and how much a client likes it.

use axum::http::header::{ACCEPT, HeaderMap};

use super::problem::{Code, Problem};
use super::v2;

/// Whether the client takes what the route sends.
pub(super) fn acceptable(headers: &HeaderMap, route: &str) -> Result<(), Problem> {
    let offers: &[&str] = match route {
        "/metrics" => &["text/plain"],
        route if route.ends_with("/progress") => &["text/event-stream"],
        "/openapi.yaml" => &["application/yaml"],
        "/docs" => &["text/html"],
        "/docs/{file}" => return Ok(()),
        // Clients of the protocol say what they decompress, and nothing of types.
        route if v2::is_under(route) || route.ends_with("/artifact") => return Ok(()),
        route if route.ends_with("/events") => &["application/x-ndjson", "text/csv", "application/vnd.apache.parquet"],
        route if route.ends_with("/evaluation") || route.ends_with("/predict") => {
            &["application/json", "application/problem+json", "text/csv", "application/vnd.apache.parquet"]
        }
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
    weight(range, offer) > 0.0
}

/// How much a range of `Accept` likes what is offered, 0 to 1.
pub(super) fn weight(range: &str, offer: &str) -> f32 {
    let mut parts = range.split(';').map(str::trim);
    let media = parts.next().unwrap_or_default();
    let family = offer.split('/').next().unwrap_or_default();
    if media != "*/*" && !media.eq_ignore_ascii_case(offer) && media != format!("{family}/*") {
        return 0.0;
    }
    parts.find_map(|part| part.strip_prefix("q=")?.parse().ok()).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn accepting(value: &'static str) -> HeaderMap {
        HeaderMap::from_iter([(ACCEPT, HeaderValue::from_static(value))])
    }

    #[test]
    fn accept_is_honoured_with_wildcards_and_refusals() {
        let ok = |accept| acceptable(&accepting(accept), "/v1/models").is_ok();
        assert!(ok("*/*") && ok("application/*") && ok("text/html, application/json;q=0.5"));
        assert!(!ok("text/html") && !ok("application/json;q=0"));
        assert!(acceptable(&accepting("text/event-stream"), "/v1/x/progress").is_ok());
        assert!(acceptable(&HeaderMap::new(), "/metrics").is_ok());
    }
}
