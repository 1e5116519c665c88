//! A model's revision as its `ETag`, and `If-Match` against it.

use axum::http::HeaderMap;
use axum::http::header::IF_MATCH;

use super::problem::{Code, Problem};
use crate::lineage::Model;

/// The `ETag` of a model as it stands.
#[must_use]
pub(super) fn etag(model: &Model) -> String {
    format!("\"{}-{}\"", model.model_id, model.revision)
}

/// Refuses when the request was meant for another revision.
///
/// # Errors
/// 412 when `If-Match` is there and names neither this revision nor `*`.
pub(super) fn check_if_match(headers: &HeaderMap, model: &Model) -> Result<(), Problem> {
    let current = etag(model);
    if is_meant(headers, &current) {
        Ok(())
    } else {
        Err(Code::PreconditionFailed.because(format!("its ETag is {current}")))
    }
}

/// Whether a request is meant for the revision `current`.
pub(super) fn is_meant(headers: &HeaderMap, current: &str) -> bool {
    let mut wanted = headers.get_all(IF_MATCH).iter().peekable();
    if wanted.peek().is_none() {
        return true;
    }
    wanted
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|tag| matches!(tag.trim(), "*") || tag.trim() == current)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consolidation::Method;
    use crate::lineage::{ModelName, ModelSettings};
    use axum::http::HeaderValue;

    #[test]
    fn if_match_takes_the_revision_or_anything() {
        let model = Model {
            model_id: 1,
            name: ModelName::parse("a").unwrap(),
            method: Method::Ewc,
            settings: ModelSettings::default(),
            live: None,
            head: None,
            paused: false,
            revision: 4,
            created_at: jiff::Timestamp::UNIX_EPOCH,
        };
        let check = |value: &str| {
            let headers = HeaderMap::from_iter([(IF_MATCH, HeaderValue::from_str(value).unwrap())]);
            check_if_match(&headers, &model).is_ok()
        };
        assert!(check(&etag(&model)) && check("*") && check("\"0-0\", \"1-4\""));
        assert!(!check("\"1-3\"") && !check("W/\"1-4\"") && !check("1-4"));
        assert!(check_if_match(&HeaderMap::new(), &model).is_ok());
    }
}
