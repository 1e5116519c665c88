//! A running server, spoken to over its interface, encrypted or not.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, anyhow, bail};
use bytes::Bytes;
use clap::Args;
use http_body_util::{BodyExt, Full};
use hyper::header::{AUTHORIZATION, CONTENT_TYPE, HeaderValue};
use hyper::{Method, Request};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::client::legacy::Client;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::TokioExecutor;
use serde_json::Value;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::CertificateDer;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};

/// Which server, and how it is spoken to.
#[derive(Debug, Args)]
pub(super) struct ServerArguments {
    /// A running server instead of a database file
    #[arg(long, value_name = "URL", conflicts_with = "database")]
    server: Option<String>,
    /// The key that is shown to the server
    #[arg(long, value_name = "KEY", env = "HEADWAY_KEY", hide_env_values = true)]
    key: Option<String>,
    /// Certificates (PEM) that vouch for the server's [default: those that the system trusts]
    #[arg(long, value_name = "FILE", requires = "server")]
    ca: Option<PathBuf>,
}

impl ServerArguments {
    /// The server, where one is named.
    pub(super) fn remote(&self) -> anyhow::Result<Option<Remote>> {
        let remote = |url: &String| Remote::new(url, self.key.as_deref(), self.ca.as_deref());
        self.server.as_ref().map(remote).transpose()
    }
}

/// A server, and the key that it is shown.
pub(super) struct Remote {
    http: Client<HttpsConnector<HttpConnector>, Full<Bytes>>,
    url: String,
    authorization: Option<HeaderValue>,
}

impl Remote {
    /// The server at `url`, whose certificate is to be one of those in `ca`, or from there; else one that the system trusts.
    fn new(url: &str, key: Option<&str>, ca: Option<&Path>) -> anyhow::Result<Self> {
        let connector = HttpsConnectorBuilder::new();
        let connector = match ca {
            None if url.starts_with("https:") => connector
                .with_provider_and_native_roots(ring::default_provider())
                .context("the system has no certificates to trust; --ca FILE names some")?,
            _ => connector.with_tls_config(trusting(ca)?),
        };
        let http = Client::builder(TokioExecutor::new()).build(connector.https_or_http().enable_http1().build());
        let authorization = match key {
            None => None,
            Some(key) => {
                let mut bearer = HeaderValue::from_str(&format!("Bearer {key}"))
                    .map_err(|_| anyhow!("--key is no key: hw_, and so on"))?;
                bearer.set_sensitive(true);
                Some(bearer)
            }
        };
        Ok(Self { http, url: url.trim_end_matches('/').to_owned(), authorization })
    }

    /// What the server answers, when it does what it is asked.
    pub(super) async fn send(&self, method: Method, path: &str, body: Option<&Value>) -> anyhow::Result<Value> {
        let mut request = Request::builder().method(method).uri(format!("{}{path}", self.url));
        if let Some(bearer) = &self.authorization {
            request = request.header(AUTHORIZATION, bearer);
        }
        if body.is_some() {
            request = request.header(CONTENT_TYPE, "application/json");
        }
        let body = body.map_or_else(Bytes::new, |body| body.to_string().into());
        let request = request.body(Full::new(body)).context("--server is no URL")?;
        let response = self.http.request(request).await.with_context(|| format!("cannot speak to {}", self.url))?;
        let status = response.status();
        let bytes = response.into_body().collect().await?.to_bytes();
        let body: Value = serde_json::from_slice(&bytes).unwrap_or_default();
        if status.is_success() {
            return Ok(body);
        }
        let told = |member: &str| body[member].as_str().unwrap_or_default().to_owned();
        bail!("the server answered {status}: {}: {}", told("title"), told("detail"))
    }
}

/// A client's side of TLS that trusts the certificates in this file.
fn trusting(ca: Option<&Path>) -> anyhow::Result<ClientConfig> {
    let mut roots = RootCertStore::empty();
    if let Some(path) = ca {
        let shown = path.display();
        let certificates = CertificateDer::pem_file_iter(path).with_context(|| format!("--ca: cannot read {shown}"))?;
        for certificate in certificates {
            roots.add(certificate.with_context(|| format!("--ca: {shown}"))?)?;
        }
    }
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
    Ok(config.with_safe_default_protocol_versions()?.with_root_certificates(roots).with_no_client_auth())
}
