//! Keys of a running server.

use anyhow::bail;
use hyper::Method;
use serde_json::{Value, json};

use crate::access::KeyWish;
use crate::cli::service::Service;

/// A server whose keys are meant.
pub(super) struct Server(pub(super) Service);

impl Server {
    pub(super) async fn create(&self, wish: &KeyWish) -> anyhow::Result<Value> {
        let KeyWish { name, scopes, models, expires_at } = wish;
        let expires_at = expires_at.map(|at| at.to_string());
        let body = json!({"name": name, "scopes": scopes, "models": models, "expires_at": expires_at});
        self.0.send(Method::POST, "/v1/keys", Some(&body)).await
    }

    pub(super) async fn list(&self) -> anyhow::Result<Vec<Value>> {
        self.0.list("/v1/keys", "keys").await
    }

    pub(super) async fn revoke(&self, key_id: &str, force: bool) -> anyhow::Result<Value> {
        // It becomes a part of the path.
        if !key_id.bytes().all(|byte| byte.is_ascii_alphanumeric()) {
            bail!("{key_id:?} is no key's id: 16 hexadecimal digits");
        }
        self.0.send(Method::DELETE, &format!("/v1/keys/{key_id}?force={force}"), None).await
    }
}
