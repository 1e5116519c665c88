//! The gate: what a route needs of who calls it, and whether a request has that. It is asked before a body is read.
//!
//! While there has never been a key, everybody is let in, and the server listens on loopback alone. The first key closes the
//! gate for good: keys that have expired or were revoked stay in the table, so that it is never empty again.

use std::sync::Arc;

use arc_swap::ArcSwap;
use axum::extract::FromRequestParts;
use axum::http::Method;
use axum::http::header::{
    AUTHORIZATION, HOST, HeaderMap, HeaderName, HeaderValue, ORIGIN, RETRY_AFTER, WWW_AUTHENTICATE,
};
use axum::http::request::Parts;
use serde_json::{Map, json};
use tokio::sync::Mutex;

use super::problem::{Code, Problem, RequestContext};
use crate::access::{AccessSettings, Class, Entry, Key, KeyTable, Policy, Scope, Standing, TooMany, Unrecognised};
use crate::store::{Actor, Store, StoreError};

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
#[derive(Debug)]
pub struct Gate {
    keys: ArcSwap<KeyTable>,
    reading: Mutex<()>,
    settings: AccessSettings,
    /// Origins of web pages that may use the interface.
    origins: Vec<String>,
    /// Whether it stays open whatever keys there are.
    of_the_owner: bool,
}

/// Who sent a request: the owner of a key, or whoever reaches a server that has none.
#[derive(Debug, Clone)]
pub(super) struct Caller(Option<Arc<Key>>);

/// A request that is let in.
#[derive(Debug)]
pub(super) struct Admitted {
    /// Who sent it.
    pub(super) caller: Caller,
    /// How much the key may still ask, where that is limited.
    pub(super) standing: Option<Standing>,
}

impl Gate {
    /// One that nobody has a key to yet.
    #[must_use]
    pub fn new(settings: AccessSettings, origins: Vec<String>) -> Self {
        Self { keys: ArcSwap::default(), reading: Mutex::default(), settings, origins, of_the_owner: false }
    }

    /// One that lets everybody in, whatever keys there are: for the process that owns the database and listens nowhere.
    #[must_use]
    pub fn of_the_owner(settings: AccessSettings) -> Self {
        Self { of_the_owner: true, ..Self::new(settings, Vec::new()) }
    }

    /// Limits of keys.
    #[must_use]
    pub fn settings(&self) -> &AccessSettings {
        &self.settings
    }

    /// Reads every key again. Due after each commit that changes one: from then on it holds.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn refresh(&self, store: &Store) -> Result<(), StoreError> {
        if self.of_the_owner {
            return Ok(());
        }
        // One after another, so that what is stored last was read last.
        let _turn = self.reading.lock().await;
        let keys = store.stored_keys().await?;
        let next = self.keys.load().followed_by(keys, &self.settings);
        self.keys.store(Arc::new(next));
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
    /// 401 without an active key, 403 with one that does not reach so far, 429 with one that asked too much.
    pub(super) fn admit(
        &self,
        method: &Method,
        headers: &HeaderMap,
        need: Need,
        model: Option<&str>,
    ) -> Result<Admitted, Problem> {
        let keys = self.keys.load();
        // Predictions change nothing.
        if keys.is_open() && !method.is_safe() && need != Need::May(Scope::Predict) {
            self.refuse_page(headers)?;
        }
        let (entry, standing) = check(&keys, headers, need, model)?;
        Ok(Admitted { caller: Caller(entry.map(|entry| Arc::clone(&entry.key))), standing })
    }

    /// Refuses a change that a page from elsewhere makes a browser ask for. Browsers send some requests of any page anywhere,
    /// and only keep its scripts from reading what is answered; where no key is asked for, that is enough to do harm.
    fn refuse_page(&self, headers: &HeaderMap) -> Result<(), Problem> {
        let Some(origin) = headers.get(ORIGIN) else { return Ok(()) };
        let own = origin.to_str().ok().and_then(|origin| origin.split_once("://")).map(|(_, host)| host.as_bytes());
        let named = self.origins.iter().any(|named| named.as_bytes() == origin.as_bytes());
        if named || own.is_some() && own == headers.get(HOST).map(HeaderValue::as_bytes) {
            return Ok(());
        }
        Err(Code::ForeignPage
            .because("without keys, pages from elsewhere change nothing; server.cors_origins names others"))
    }

    /// Whether somebody who was let in still would be, for what takes long: keys end meanwhile.
    pub(super) fn still_admits(&self, caller: &Caller) -> bool {
        let keys = self.keys.load();
        caller.0.as_ref().map_or_else(|| keys.is_open(), |key| keys.is_active(key.key_id))
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
) -> Result<(Option<&'a Entry>, Option<Standing>), Problem> {
    if keys.is_open() || need == Need::Nothing {
        return Ok((None, None));
    }
    let entry = keys.recognise(bearer(headers).unwrap_or_default()).map_err(stranger)?;
    let class = if need == Need::May(Scope::Predict) { Class::Predict } else { Class::Default };
    let standing = entry.meters.take(class).map_err(|too_many| impatient(&too_many))?;
    let key = &entry.key;
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
        _ => Ok((Some(entry), standing)),
    }
}

/// The one key that a request brings.
pub(super) fn bearer(headers: &HeaderMap) -> Option<&[u8]> {
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

/// A 429 that says how long to wait.
fn impatient(TooMany { standing, retry_after_s }: &TooMany) -> Problem {
    let Policy { requests, window_s, .. } = standing.policy;
    let detail = format!("a key may ask {requests} times within {window_s} s; one more is taken in {retry_after_s} s");
    let problem = Code::RateLimited.because(detail).with_header(RETRY_AFTER, (*retry_after_s).into());
    limits(standing).into_iter().fold(problem, |problem, (name, value)| problem.with_header(name, value))
}

/// The headers that tell where a key stands (draft-ietf-httpapi-ratelimit-headers).
pub(super) fn limits(standing: &Standing) -> [(HeaderName, HeaderValue); 2] {
    let Standing { policy: Policy { class, requests, window_s }, remaining, full_in_s } = standing;
    let name = class.as_str();
    [
        (HeaderName::from_static("ratelimit-policy"), format!(r#""{name}";q={requests};w={window_s}"#)),
        (HeaderName::from_static("ratelimit"), format!(r#""{name}";r={remaining};t={full_in_s}"#)),
    ]
    .map(|(name, value)| (name, HeaderValue::try_from(value).expect("words and numbers")))
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
        self.0.as_ref().map_or_else(|| Actor::local().name, |key| key.key_id.to_string())
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

/// Who changes are made for: the caller, in this request.
impl<S: Sync> FromRequestParts<S> for Actor {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let name = Caller::from_request_parts(parts, state).await?.name();
        let RequestContext { request_id, .. } = RequestContext::from_request_parts(parts, state).await?;
        Ok(Self { name, request_id: Some(request_id) })
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
