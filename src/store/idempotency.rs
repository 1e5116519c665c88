//! Answers to POSTs that carried an `Idempotency-Key`: written in the transaction of their effect, replayed for a day.

use jiff::{SignedDuration, Timestamp};
use sqlx::{Row, query};

use super::{Store, StoreError, WriteTransaction};

/// What identifies a request that may be repeated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RequestIdentity {
    /// The client's key.
    pub key: String,
    /// Who asks: nobody is given what somebody else was answered.
    pub caller: String,
    /// Method and path.
    pub route: String,
    /// SHA-256 over query, content type and body.
    pub request_sha256: [u8; 32],
}

/// An answer as it was first given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredAnswer {
    /// HTTP status, kept as the number it is.
    pub status: u16,
    /// Names and values, in order.
    pub headers: Vec<(String, String)>,
    /// The body's bytes.
    pub body: Vec<u8>,
}

/// What is known of a request's key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Recollection {
    /// Never seen, or forgotten.
    New,
    /// The same request was answered so.
    Answered(StoredAnswer),
    /// The key belonged to another request.
    OtherRequest,
}

impl Store {
    /// What is known of `identity`'s key; answers older than `keep_s` seconds are forgotten.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn recall(&self, identity: &RequestIdentity, keep_s: u32) -> Result<Recollection, StoreError> {
        let row = query(
            "select request_sha256, status, headers, body from idempotency \
             where idempotency_key = ? and caller = ? and route = ? and created_at >= ?",
        )
        .bind(&identity.key)
        .bind(&identity.caller)
        .bind(&identity.route)
        .bind(oldest_kept(keep_s))
        .fetch_optional(&self.readers)
        .await?;
        let Some(row) = row else { return Ok(Recollection::New) };
        if row.try_get::<&[u8], _>("request_sha256")? != identity.request_sha256 {
            return Ok(Recollection::OtherRequest);
        }
        Ok(Recollection::Answered(StoredAnswer {
            status: row.try_get("status")?,
            headers: serde_json::from_str(row.try_get("headers")?)
                .map_err(|e| StoreError::malformed("stored answer", e))?,
            body: row.try_get("body")?,
        }))
    }
}

/// Keeps an answer beside its effect, with the batch that it quotes, and drops what is older than `keep_s` seconds.
///
/// # Errors
/// When the database cannot be written.
pub async fn keep(
    transaction: &mut WriteTransaction,
    identity: &RequestIdentity,
    answer: &StoredAnswer,
    batch_id: Option<i64>,
    keep_s: u32,
) -> Result<(), StoreError> {
    query("delete from idempotency where created_at < ?").bind(oldest_kept(keep_s)).execute(&mut **transaction).await?;
    query(
        "insert into idempotency (idempotency_key, caller, route, request_sha256, status, headers, body, batch_id, created_at) \
         values (?, ?, ?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(&identity.key)
    .bind(&identity.caller)
    .bind(&identity.route)
    .bind(identity.request_sha256.as_slice())
    .bind(answer.status)
    .bind(serde_json::to_string(&answer.headers).expect("text"))
    .bind(&answer.body)
    .bind(batch_id)
    .bind(Timestamp::now().to_string())
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

fn oldest_kept(keep_s: u32) -> String {
    let age = SignedDuration::from_secs(keep_s.into());
    Timestamp::now().checked_sub(age).unwrap_or(Timestamp::UNIX_EPOCH).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::fixture::settings;

    #[tokio::test]
    async fn an_answer_is_recalled_for_the_same_request_only_and_forgotten_when_old() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::open(&settings(&directory)).await.unwrap();
        let identity = RequestIdentity {
            key: "k".to_owned(),
            caller: "local".to_owned(),
            route: "POST /v1/models".to_owned(),
            request_sha256: [1; 32],
        };
        let answer = StoredAnswer {
            status: 201,
            headers: vec![("location".to_owned(), "/v1/models/a".to_owned())],
            body: b"{}".to_vec(),
        };
        assert_eq!(store.recall(&identity, 60).await.unwrap(), Recollection::New);
        let mut tx = store.begin().await.unwrap();
        keep(&mut tx, &identity, &answer, None, 60).await.unwrap();
        tx.commit().await.unwrap();
        assert_eq!(store.recall(&identity, 60).await.unwrap(), Recollection::Answered(answer));
        let other = RequestIdentity { request_sha256: [2; 32], ..identity.clone() };
        assert_eq!(store.recall(&other, 60).await.unwrap(), Recollection::OtherRequest);
        let elsewhere = RequestIdentity { route: "POST /v1/other".to_owned(), ..identity.clone() };
        assert_eq!(store.recall(&elsewhere, 60).await.unwrap(), Recollection::New);
        let somebody = RequestIdentity { caller: "somebody".to_owned(), ..identity.clone() };
        assert_eq!(store.recall(&somebody, 60).await.unwrap(), Recollection::New);
        assert_eq!(store.recall(&identity, 0).await.unwrap(), Recollection::New);
    }
}
