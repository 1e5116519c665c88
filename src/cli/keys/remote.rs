//! Keys of a running server.

use anyhow::{Context, bail};
use hyper::Method;
use serde_json::{Value, json};

use crate::access::KeyWish;
use crate::cli::remote::Remote;

/// A server whose keys are meant.
pub(super) struct Server(pub(super) Remote);

impl Server {
    pub(super) async fn create(&self, wish: &KeyWish) -> anyhow::Result<Value> {
        let KeyWish { name, scopes, models, expires_at } = wish;
        let expires_at = expires_at.map(|at| at.to_string());
        let body = json!({"name": name, "scopes": scopes, "models": models, "expires_at": expires_at});
        self.0.send(Method::POST, "/v1/keys", Some(&body)).await
    }

    pub(super) async fn list(&self) -> anyhow::Result<Vec<Value>> {
        let (mut listed, mut token) = (Vec::new(), String::new());
        loop {
            let mut page = self.0.send(Method::GET, &format!("/v1/keys?page_size=1000{token}"), None).await?;
            listed.append(page["keys"].as_array_mut().context("the server answered without keys")?);
            match page["next_page_token"].as_str() {
                Some(next) => token = format!("&page_token={next}"),
                None => return Ok(listed),
            }
        }
    }

    pub(super) async fn revoke(&self, key_id: &str, force: bool) -> anyhow::Result<Value> {
        // It becomes a part of the path.
        if !key_id.bytes().all(|byte| byte.is_ascii_alphanumeric()) {
            bail!("{key_id:?} is no key's id: 16 hexadecimal digits");
        }
        self.0.send(Method::DELETE, &format!("/v1/keys/{key_id}?force={force}"), None).await
    }
}
