//! The gate: what a route needs of who calls it, and whether a request has that. It is asked before a body is read.
//!
//! While there has never been a key, everybody is let in, and the server listens on loopback alone. The first key closes the
//! gate for good: keys that have expired or were revoked stay in the table, so that it is never empty again.

use std::sync::Arc;

use arc_swap::ArcSwap;
use axum::extract::FromRequestParts;
use axum::http::header::{AUTHORIZATION, HeaderMap, HeaderValue, WWW_AUTHENTICATE};
use axum::http::request::Parts;
use serde_json::{Map, json};
use tokio::sync::Mutex;

use super::problem::{Code, Problem};
use crate::access::{Key, KeyTable, Scope, Unrecognised};
use crate::store::{Store, StoreError};

/// What a route needs of who calls it, once there are keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// Nothing: anybody may ask.
    Nothing,
    /// A key; where the path names a model, one that is for it, and else the answer is about what the key is for.
    AnyKey,
    /// A key that is for every model.
    EveryModel,
    /// A key with this scope; where the path names a model, one that is for it, and else one that is for every model.
    May(Scope),
}

/// Who is let in.
#[derive(Debug, Default)]
pub struct Gate {
    keys: ArcSwap<KeyTable>,
    reading: Mutex<()>,
}

/// Who sent a request: the owner of a key, or whoever reaches a server that has none.
#[derive(Debug, Clone)]
pub(super) struct Caller(Option<Arc<Key>>);

impl Gate {
    /// Reads every key again. Due after each commit that changes one: from then on it holds.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn refresh(&self, store: &Store) -> Result<(), StoreError> {
        // One after another, so that what is stored last was read last.
        let _turn = self.reading.lock().await;
        self.keys.store(Arc::new(store.stored_keys().await?.into_iter().collect()));
        Ok(())
    }

    /// Whether everybody is let in, because there has never been a key.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.keys.load().is_open()
    }

    /// Who sent a request with these headers, where what it asks `need`s is given.
    ///
    /// # Errors
    /// 401 without an active key, 403 with one that does not reach so far.
    pub(super) fn admit(&self, headers: &HeaderMap, need: Need, model: Option<&str>) -> Result<Caller, Problem> {
        Ok(Caller(check(&self.keys.load(), headers, need, model)?.cloned()))
    }

    /// As [`Self::admit`], where it does not matter who it is.
    ///
    /// # Errors
    /// As [`Self::admit`].
    pub(super) fn pass(&self, headers: &HeaderMap, need: Need, model: Option<&str>) -> Result<(), Problem> {
        check(&self.keys.load(), headers, need, model).map(drop)
    }
}

fn check<'a>(
    keys: &'a KeyTable,
    headers: &HeaderMap,
    need: Need,
    model: Option<&str>,
) -> Result<Option<&'a Arc<Key>>, Problem> {
    if keys.is_open() || need == Need::Nothing {
        return Ok(None);
    }
    let key = keys.recognise(bearer(headers).unwrap_or_default()).map_err(stranger)?;
    if let Need::May(scope) = need
        && !key.scopes.allow(scope)
    {
        return Err(lacking(scope));
    }
    match (model, need) {
        (Some(model), _) if !key.covers(model) => {
            Err(Code::ModelForbidden.because(format!("the key is not for the model {model:?}")))
        }
        (None, Need::May(_) | Need::EveryModel) if key.models.is_some() => {
            Err(Code::ModelForbidden.because("the key is for some models only, and this call is about more than these"))
        }
        _ => Ok(Some(key)),
    }
}

/// The one key that a request brings.
fn bearer(headers: &HeaderMap) -> Option<&[u8]> {
    const SCHEME: &[u8] = b"bearer ";
    let mut given = headers.get_all(AUTHORIZATION).iter();
    let (Some(only), None) = (given.next(), given.next()) else { return None };
    let (scheme, key) = only.as_bytes().split_at_checked(SCHEME.len())?;
    scheme.eq_ignore_ascii_case(SCHEME).then(|| key.trim_ascii())
}

/// A 401. Who has no key of ours is told nothing; who has the whole of one is told why it opens nothing any more.
fn stranger(why: Unrecognised) -> Problem {
    let (problem, challenge) = match why {
        Unrecognised::Unknown => {
            (Code::Unauthenticated.because("send one as `Authorization: Bearer hw_…`"), r#"Bearer realm="headway""#)
        }
        Unrecognised::Expired(at) => (
            Code::KeyExpired.because(format!("it was good until {at}")),
            r#"Bearer realm="headway", error="invalid_token""#,
        ),
        Unrecognised::Revoked(at) => (
            Code::KeyRevoked.because(format!("it was ended at {at}")),
            r#"Bearer realm="headway", error="invalid_token""#,
        ),
    };
    problem.with_header(WWW_AUTHENTICATE, HeaderValue::from_static(challenge))
}

/// A 403 that names the scope.
fn lacking(scope: Scope) -> Problem {
    let name = scope.as_str();
    let challenge = format!(r#"Bearer realm="headway", error="insufficient_scope", scope="{name}""#);
    Code::InsufficientScope
        .because(format!("this takes a key with the scope {name}"))
        .with_members(Map::from_iter([("scope".to_owned(), json!(name))]))
        .with_header(WWW_AUTHENTICATE, HeaderValue::from_str(&challenge).expect("words"))
}

impl Caller {
    /// Who it is, in the history and the audit log: the key's id, or `local`.
    pub(super) fn name(&self) -> String {
        self.0.as_ref().map_or_else(|| "local".to_owned(), |key| key.key_id.to_string())
    }

    /// The only models the caller may know of; none: every model.
    pub(super) fn models(&self) -> Option<&[crate::lineage::ModelName]> {
        self.0.as_ref()?.models.as_deref()
    }

    /// Asks for more than the route needs, because of what the query says.
    ///
    /// # Errors
    /// 403 without the scope.
    pub(super) fn must(&self, scope: Scope) -> Result<(), Problem> {
        match &self.0 {
            Some(key) if !key.scopes.allow(scope) => Err(lacking(scope)),
            _ => Ok(()),
        }
    }
}

impl<S: Sync> FromRequestParts<S> for Caller {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        parts.extensions.get().cloned().ok_or_else(|| Problem::internal("a route outside the gate"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bearer_is_read_and_anything_else_is_none() {
        let headers = |values: &[&'static str]| {
            values.iter().map(|value| (AUTHORIZATION, HeaderValue::from_static(value))).collect::<HeaderMap>()
        };
        let read = |values| bearer(&headers(values)).map(<[u8]>::to_vec);
        assert_eq!(read(&["Bearer hw_x"]), Some(b"hw_x".to_vec()));
        assert_eq!(read(&["bearer  hw_x "]), Some(b"hw_x".to_vec()));
        for none in [&[][..], &["Basic hw_x"], &["hw_x"], &["Bearer"], &["Bearer a", "Bearer b"]] {
            assert_eq!(read(none), None, "{none:?}");
        }
    }
}
