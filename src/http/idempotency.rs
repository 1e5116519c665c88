//! `Idempotency-Key`: the same request is answered once, however often it is sent.

use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

use axum::extract::FromRequestParts;
use axum::http::HeaderMap;
use axum::http::request::Parts;

use super::AppState;
use super::answer::Answer;
use super::gate::Caller;
use super::problem::{Code, Problem};
use crate::store::idempotency::{self, Recollection, RequestIdentity};
use crate::store::{StoreError, WriteTransaction};

/// Longest key accepted, in bytes.
pub(super) const MAX_KEY_BYTES: usize = 255;

/// Requests with a key that are being answered.
#[derive(Debug, Default)]
pub struct InFlight(Mutex<HashSet<Claim>>);

/// A key, whose it is, and what it was sent to: the same key is another one to somebody else.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Claim {
    key: String,
    caller: String,
    route: String,
}

/// A request that may carry a key. Holding it keeps a second request with the same key out.
#[derive(Debug)]
pub(super) struct Repeatable {
    app: Arc<AppState>,
    claim: Option<Claim>,
}

impl FromRequestParts<Arc<AppState>> for Repeatable {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<AppState>) -> Result<Self, Problem> {
        let Some(key) = key(&parts.headers)?.map(str::to_owned) else {
            return Ok(Self { app: Arc::clone(app), claim: None });
        };
        let caller = Caller::from_request_parts(parts, app).await?.name();
        let claim = Claim { key, caller, route: format!("{} {}", parts.method, parts.uri.path()) };
        if !app.in_flight.0.lock().unwrap_or_else(PoisonError::into_inner).insert(claim.clone()) {
            return Err(Problem::busy(Code::IdempotencyInFlight, "wait for its answer, then repeat the request"));
        }
        Ok(Self { app: Arc::clone(app), claim: Some(claim) })
    }
}

/// The key that a request carries, if it does.
pub(super) fn key(headers: &HeaderMap) -> Result<Option<&str>, Problem> {
    let Some(header) = headers.get("idempotency-key") else { return Ok(None) };
    let key = header.to_str().ok().filter(|key| (1..=MAX_KEY_BYTES).contains(&key.len()));
    key.map(Some).ok_or_else(|| {
        Code::MalformedHeader.because(format!("Idempotency-Key takes 1 to {MAX_KEY_BYTES} visible ASCII characters"))
    })
}

impl Repeatable {
    /// The answer this request got before; `None` when it is new or carries no key.
    ///
    /// # Errors
    /// When the key belongs to another request.
    pub(super) async fn recall(&self, request_sha256: [u8; 32]) -> Result<Option<Answer>, Problem> {
        let Some(identity) = self.identity(request_sha256) else { return Ok(None) };
        match self.app.store.recall(&identity, self.app.settings.idempotency_keep_s).await? {
            Recollection::New => Ok(None),
            Recollection::Answered(answer) => Ok(Some(answer.into())),
            Recollection::OtherRequest => {
                Err(Code::IdempotencyMismatch.because("the first request with this key had another body or query"))
            }
        }
    }

    /// Keeps `answer` in the transaction of its effect.
    ///
    /// # Errors
    /// When the database fails.
    pub(super) async fn keep(
        &self,
        tx: &mut WriteTransaction,
        request_sha256: [u8; 32],
        answer: &Answer,
    ) -> Result<(), StoreError> {
        self.keep_about(tx, request_sha256, answer, None).await
    }

    /// As [`Self::keep`], of an answer that quotes a batch, and goes when that is erased.
    ///
    /// # Errors
    /// When the database fails.
    pub(super) async fn keep_about(
        &self,
        tx: &mut WriteTransaction,
        request_sha256: [u8; 32],
        answer: &Answer,
        batch_id: Option<i64>,
    ) -> Result<(), StoreError> {
        let Some(identity) = self.identity(request_sha256) else { return Ok(()) };
        let keep_s = self.app.settings.idempotency_keep_s;
        idempotency::keep(tx, &identity, answer.as_stored(), batch_id, keep_s).await
    }

    fn identity(&self, request_sha256: [u8; 32]) -> Option<RequestIdentity> {
        let Claim { key, caller, route } = self.claim.clone()?;
        Some(RequestIdentity { key, caller, route, request_sha256 })
    }
}

impl Drop for Repeatable {
    fn drop(&mut self) {
        if let Some(claim) = &self.claim {
            self.app.in_flight.0.lock().unwrap_or_else(PoisonError::into_inner).remove(claim);
        }
    }
}
