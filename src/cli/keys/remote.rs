//! Keys of a running server.

use anyhow::{Context, bail};
use reqwest::{Method, RequestBuilder};
use serde_json::{Value, json};

use crate::access::KeyWish;

/// A server, and the key that it is shown.
pub(super) struct Remote {
    http: reqwest::Client,
    url: String,
    key: Option<String>,
}

impl Remote {
    pub(super) fn new(url: &str, key: Option<String>) -> anyhow::Result<Self> {
        let http = reqwest::Client::builder().build().context("cannot make a client")?;
        Ok(Self { http, url: url.trim_end_matches('/').to_owned(), key })
    }

    pub(super) async fn create(&self, wish: &KeyWish) -> anyhow::Result<Value> {
        let KeyWish { name, scopes, models, expires_at } = wish;
        let expires_at = expires_at.map(|at| at.to_string());
        let body = json!({"name": name, "scopes": scopes, "models": models, "expires_at": expires_at});
        self.send(self.request(Method::POST, "/v1/keys").json(&body)).await
    }

    pub(super) async fn list(&self) -> anyhow::Result<Vec<Value>> {
        let (mut listed, mut token) = (Vec::new(), String::new());
        loop {
            let mut page = self.send(self.request(Method::GET, &format!("/v1/keys?page_size=1000{token}"))).await?;
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
        self.send(self.request(Method::DELETE, &format!("/v1/keys/{key_id}?force={force}"))).await
    }

    fn request(&self, method: Method, path: &str) -> RequestBuilder {
        let request = self.http.request(method, format!("{}{path}", self.url));
        match &self.key {
            Some(key) => request.bearer_auth(key),
            None => request,
        }
    }

    async fn send(&self, request: RequestBuilder) -> anyhow::Result<Value> {
        let response = request.send().await?;
        let (status, text) = (response.status(), response.text().await?);
        let body: Value = serde_json::from_str(&text).unwrap_or_default();
        if status.is_success() {
            return Ok(body);
        }
        let told = |member: &str| body[member].as_str().unwrap_or_default().to_owned();
        bail!("the server answered {status}: {}: {}", told("title"), told("detail"))
    }
}
