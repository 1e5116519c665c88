//! `/v1/keys`: make, list and revoke keys.

use std::sync::Arc;

use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::LOCATION;
use jiff::Timestamp;
use serde::Deserialize;
use serde_json::{Value, json};

use super::AppState;
use super::answer::Answer;
use super::body::JsonBody;
use super::idempotency::Repeatable;
use super::path::KeyAt;
use super::problem::{Code, InputError, Problem};
use super::query::{Page, Query};
use crate::access::{Issued, Key, KeyDefect, KeyId, KeyWish, Scope, Scopes};
use crate::lineage::ModelName;
use crate::store::keys::{self, NoKey, Revoked};
use crate::store::{Actor, WriteTransaction};

/// The body of a wish for a key.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NewKey {
    name: Option<String>,
    scopes: Scopes,
    models: Option<Vec<ModelName>>,
    expires_at: Option<Timestamp>,
}

impl NewKey {
    /// What is asked for, at `now`.
    pub(super) fn wish(self, now: Timestamp) -> Result<KeyWish, Problem> {
        let Self { name, scopes, models, expires_at } = self;
        let wish = KeyWish { name, scopes, models, expires_at };
        wish.check(now).map_err(|defect| refusal(&defect))?;
        Ok(wish)
    }
}

/// The query of a revocation.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Revocation {
    force: Option<bool>,
}

/// A key as its managers see it.
#[must_use]
pub fn body(key: &Key, now: Timestamp) -> Value {
    json!({
        "key_id": key.key_id,
        "name": key.name,
        "scopes": key.scopes,
        "models": key.models,
        "state": key.state(now),
        "created_at": key.created_at.to_string(),
        "expires_at": key.expires_at.map(|at| at.to_string()),
        "revoked_at": key.revoked_at.map(|at| at.to_string()),
    })
}

fn missing(key_id: KeyId) -> Problem {
    Code::KeyNotFound.because(format!("there is no key {key_id}"))
}

/// `POST /v1/keys`
pub(super) async fn create(
    State(app): State<Arc<AppState>>,
    by: Actor,
    request: Repeatable,
    JsonBody { value: new, request_sha256 }: JsonBody<NewKey>,
) -> Result<Answer, Problem> {
    if let Some(answer) = request.recall(request_sha256).await? {
        return Ok(answer);
    }
    let now = Timestamp::now();
    let wish = new.wish(now)?;
    let issued = Issued::draw().map_err(Problem::internal)?;
    let mut tx = app.store.begin_for(&by).await?;
    // From the first key on the server asks for one: nobody is to be locked out by it.
    if !wish.scopes.allow(Scope::Admin) && !keys::admin_is_active(&mut tx, now).await? {
        return Err(
            Code::AdminKeyFirst.because("without one nobody could manage keys over the interface; make that first")
        );
    }
    let made = keys::create(&mut tx, &issued, &wish, app.gate.settings().max_keys, now).await?;
    let key = made.map_err(|none| match none {
        NoKey::TooMany(_) => Code::TooManyKeys.because(none.to_string()),
        NoKey::Known(_) => Problem::internal(none),
    })?;
    let answer = |secret: Option<&str>| {
        let mut shown = body(&key, now);
        shown["key"] = json!(secret);
        Answer::json(StatusCode::CREATED, &shown).with_header(&LOCATION, format!("/v1/keys/{}", key.key_id))
    };
    // The whole key is shown once and kept nowhere: the answer to the same request sent again is without it.
    request.keep(&mut tx, request_sha256, &answer(None)).await?;
    settle(&app, tx).await?;
    tracing::info!(key_id = %key.key_id, scopes = %json!(key.scopes), "key made");
    Ok(answer(Some(issued.reveal())))
}

fn refusal(defect: &KeyDefect) -> Problem {
    let error = InputError::at(format!("/{}", defect.member), defect.code, defect.detail.clone());
    Code::InvalidBody.because(defect.to_string()).with_error(error)
}

/// Commits, and lets the change hold.
async fn settle(app: &AppState, transaction: WriteTransaction) -> Result<(), Problem> {
    transaction.commit().await?;
    Ok(app.gate.refresh(&app.store).await?)
}

/// `GET /v1/keys`
pub(super) async fn list(State(app): State<Arc<AppState>>, page: Page) -> Result<Answer, Problem> {
    let (found, now) = (app.store.keys(page.after, page.fetch()).await?, Timestamp::now());
    Ok(Answer::ok(&page.body("keys", found, |(row, _)| *row, |(_, key)| body(key, now))))
}

/// `GET /v1/keys/{key_id}`
pub(super) async fn read(State(app): State<Arc<AppState>>, KeyAt(key_id): KeyAt) -> Result<Answer, Problem> {
    let key = app.store.key(key_id).await?.ok_or_else(|| missing(key_id))?;
    Ok(Answer::ok(&body(&key, Timestamp::now())))
}

/// `DELETE /v1/keys/{key_id}`
pub(super) async fn revoke(
    State(app): State<Arc<AppState>>,
    KeyAt(key_id): KeyAt,
    by: Actor,
    Query(Revocation { force }): Query<Revocation>,
) -> Result<Answer, Problem> {
    let now = Timestamp::now();
    let mut tx = app.store.begin_for(&by).await?;
    let key = match keys::revoke(&mut tx, key_id, force == Some(true), now).await? {
        Revoked::Done(key) => key,
        Revoked::Unknown => return Err(missing(key_id)),
        Revoked::LastAdmin => {
            return Err(Code::LastAdminKey.because(
                "without it keys are managed with the command line on the server's machine alone; force=true revokes it \
                 all the same",
            ));
        }
    };
    settle(&app, tx).await?;
    tracing::info!(%key_id, "key revoked");
    Ok(Answer::ok(&body(&key, now)))
}
