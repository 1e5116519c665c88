//! Query parameters: unknown ones are refused and named; lists page with `page_size` and `page_token`.

use std::sync::Arc;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

use super::problem::{Code, InputError, Problem};
use super::{AppState, ServerSettings};

/// The query, understood.
#[derive(Debug)]
pub(super) struct Query<T>(pub T);

impl<T: DeserializeOwned> FromRequestParts<Arc<AppState>> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &Arc<AppState>) -> Result<Self, Problem> {
        Self::parse(parts.uri.query().unwrap_or_default()).map(Self)
    }
}

impl<T: DeserializeOwned> Query<T> {
    /// What a query string says.
    ///
    /// # Errors
    /// Names the parameter that is unknown or unusable.
    pub(super) fn parse(query: &str) -> Result<T, Problem> {
        let uri = format!("/?{query}").parse().map_err(|e| refusal(&format!("{e}")))?;
        axum::extract::Query::<T>::try_from_uri(&uri)
            .map(|axum::extract::Query(value)| value)
            .map_err(|e| refusal(&e.body_text()))
    }
}

/// Names the parameter, which axum puts before the reason.
fn refusal(text: &str) -> Problem {
    let detail = text.strip_prefix("Failed to deserialize query string: ").unwrap_or(text).to_owned();
    let error = detail.split_once(": ").map(|(name, why)| InputError::parameter(name, "invalid_value", why));
    Code::InvalidQuery.because(detail).with_errors(error.into_iter().collect())
}

/// A page of a list: what comes after a key.
#[derive(Debug, Clone, Copy)]
pub(super) struct Page {
    /// The last key of the page before; 0 at the start.
    pub after: i64,
    size: u32,
}

/// How lists are asked for a page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PageQuery {
    page_size: Option<u32>,
    page_token: Option<String>,
}

impl FromRequestParts<Arc<AppState>> for Page {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<AppState>) -> Result<Self, Problem> {
        let Query(wanted) = Query::<PageQuery>::from_request_parts(parts, app).await?;
        wanted.page(&app.settings)
    }
}

impl PageQuery {
    /// The page that is wanted.
    pub(super) fn page(&self, settings: &ServerSettings) -> Result<Page, Problem> {
        Page::new(self.page_size, self.page_token.as_deref(), settings)
    }
}

impl Page {
    /// The page of this size (else the server's) after the one that gave this token (else the first).
    ///
    /// # Errors
    /// Names the parameter that cannot be used.
    pub(super) fn new(size: Option<u32>, token: Option<&str>, settings: &ServerSettings) -> Result<Self, Problem> {
        let size = size.unwrap_or(settings.page_size);
        if size == 0 {
            let error = InputError::parameter("page_size", "out_of_range", "at least 1");
            return Err(Code::InvalidQuery.because("page_size must be at least 1").with_error(error));
        }
        let after = token.map_or(Some(0), from_token).ok_or_else(|| {
            let error =
                InputError::parameter("page_token", "unknown_token", "a next_page_token of this list is needed");
            Code::InvalidQuery.because("page_token was not given by this list").with_error(error)
        })?;
        Ok(Self { after, size: size.min(settings.page_size_max) })
    }

    /// How many rows to ask the store for: one more than the page holds, to know whether there is a next.
    #[must_use]
    pub(super) fn fetch(&self) -> u32 {
        self.size + 1
    }

    /// The body of a list called `plural`, of rows fetched by [`Self::fetch`].
    #[must_use]
    pub(super) fn body<T>(
        &self,
        plural: &str,
        mut rows: Vec<T>,
        key: impl Fn(&T) -> i64,
        show: impl Fn(&T) -> Value,
    ) -> Map<String, Value> {
        let size = usize::try_from(self.size).expect("a page fits in memory");
        let more = rows.len() > size;
        rows.truncate(size);
        let token = if more { rows.last().map(|row| to_token(key(row))) } else { None };
        let mut body = Map::new();
        body.insert(plural.to_owned(), rows.iter().map(show).collect());
        body.insert("next_page_token".to_owned(), json!(token));
        body
    }
}

fn to_token(key: i64) -> String {
    hex::encode(format!("p{key}"))
}

/// In its one spelling, and with a key that another may come after.
fn from_token(token: &str) -> Option<i64> {
    let text = String::from_utf8(hex::decode(token).ok()?).ok()?;
    let key = text.strip_prefix('p')?.parse().ok()?;
    ((0..i64::MAX).contains(&key) && to_token(key) == token).then_some(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_names_the_next_only_when_there_is_one() {
        let page = Page { after: 0, size: 2 };
        let body = page.body("numbers", vec![5, 6, 7], |&n| n, |&n| json!(n));
        assert_eq!(body["numbers"], json!([5, 6]));
        assert_eq!(from_token(body["next_page_token"].as_str().unwrap()), Some(6));
        let last = page.body("numbers", vec![7], |&n| n, |&n| json!(n));
        assert_eq!(last["next_page_token"], Value::Null);
    }

    #[test]
    fn a_made_up_token_is_known() {
        for bad in
            ["", "5", "zz", "ff", &hex::encode("p-1"), &hex::encode("q1"), &hex::encode("p+1"), &hex::encode("p01")]
        {
            assert_eq!(from_token(bad), None, "{bad}");
        }
        assert_eq!(from_token(&to_token(i64::MAX - 1)), Some(i64::MAX - 1));
        assert_eq!(from_token(&to_token(i64::MAX)), None);
    }
}
