//! A running server, spoken to over its interface, encrypted or not.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, anyhow};
use bytes::Bytes;
use clap::Args;
use futures_util::Stream;
use http_body_util::combinators::UnsyncBoxBody;
use http_body_util::{BodyExt, Full, StreamBody};
use hyper::body::{Frame, Incoming};
use hyper::header::{AUTHORIZATION, CONTENT_ENCODING, CONTENT_TYPE, HeaderValue};
use hyper::http::request::Builder;
use hyper::{Method, Request, Response};
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
    /// A file with the key alone in it, instead of --key
    #[arg(long, value_name = "FILE", requires = "server")]
    key_file: Option<PathBuf>,
    /// Certificates (PEM) that vouch for the server's [default: those that the system trusts]
    #[arg(long, value_name = "FILE", requires = "server")]
    ca: Option<PathBuf>,
}

impl ServerArguments {
    /// The server, where one is named.
    pub(super) fn remote(&self) -> anyhow::Result<Option<Remote>> {
        let Some(url) = &self.server else { return Ok(None) };
        let from_file = match &self.key_file {
            None => None,
            Some(path) => {
                let text = std::fs::read_to_string(path);
                Some(text.with_context(|| format!("--key-file: cannot read {}", path.display()))?.trim().to_owned())
            }
        };
        let key = from_file.as_deref().or(self.key.as_deref());
        Remote::new(url, key, self.ca.as_deref()).map(Some)
    }
}

/// Answers that say of the body that it is not taken, and nothing of the server.
const OF_THE_BODY: [u16; 4] = [400, 413, 415, 422];

/// A body that is read while it is sent.
pub(super) struct FileBody<S> {
    pub(super) content_type: &'static str,
    pub(super) content_encoding: Option<&'static str>,
    pub(super) chunks: S,
}

/// A server, and the key that it is shown.
pub(super) struct Remote {
    http: Client<HttpsConnector<HttpConnector>, UnsyncBoxBody<Bytes, io::Error>>,
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
        let mut request = self.request(method, path);
        if body.is_some() {
            request = request.header(CONTENT_TYPE, "application/json");
        }
        let body = Full::new(body.map_or_else(Bytes::new, |body| body.to_string().into()));
        let body = body.map_err(|never| match never {}).boxed_unsync();
        let answer = self.answer(request, body).await?;
        if answer.is_success { Ok(answer.body) } else { Err(answer.refusal()) }
    }

    /// Posts a body, and gives whether it was taken, and what is answered; a refusal of what the body holds is an answer too.
    pub(super) async fn upload<S>(&self, path: &str, body: FileBody<S>) -> anyhow::Result<(bool, Value)>
    where
        S: Stream<Item = io::Result<Frame<Bytes>>> + Send + 'static,
    {
        let mut request = self.request(Method::POST, path).header(CONTENT_TYPE, body.content_type);
        if let Some(encoding) = body.content_encoding {
            request = request.header(CONTENT_ENCODING, encoding);
        }
        let answer = self.answer(request, StreamBody::new(body.chunks).boxed_unsync()).await?;
        let of_the_body = OF_THE_BODY.contains(&answer.status) && answer.body["code"].is_string();
        if answer.is_success || of_the_body { Ok((answer.is_success, answer.body)) } else { Err(answer.refusal()) }
    }

    /// Writes what the server hands out, piece by piece.
    pub(super) async fn download(&self, path: &str, file: &mut File) -> anyhow::Result<()> {
        let nothing = Full::new(Bytes::new()).map_err(|never| match never {}).boxed_unsync();
        let request = self.request(Method::GET, path).body(nothing).context("--server is no URL")?;
        let response = self.http.request(request).await.with_context(|| format!("cannot speak to {}", self.url))?;
        if !response.status().is_success() {
            return Err(Answer::of(response).await?.refusal());
        }
        let mut body = response.into_body();
        while let Some(frame) = body.frame().await {
            if let Some(bytes) = frame.context("the server broke off")?.data_ref() {
                file.write_all(bytes)?;
            }
        }
        Ok(())
    }

    fn request(&self, method: Method, path: &str) -> Builder {
        let request = Request::builder().method(method).uri(format!("{}{path}", self.url));
        match &self.authorization {
            Some(bearer) => request.header(AUTHORIZATION, bearer),
            None => request,
        }
    }

    async fn answer(&self, request: Builder, body: UnsyncBoxBody<Bytes, io::Error>) -> anyhow::Result<Answer> {
        let request = request.body(body).context("--server is no URL")?;
        let response = self.http.request(request).await.with_context(|| format!("cannot speak to {}", self.url))?;
        Answer::of(response).await
    }
}

/// What a server answered.
struct Answer {
    status: u16,
    /// With its reason.
    shown: String,
    is_success: bool,
    body: Value,
}

impl Answer {
    async fn of(response: Response<Incoming>) -> anyhow::Result<Self> {
        let status = response.status();
        let bytes = response.into_body().collect().await?.to_bytes();
        let (is_success, shown) = (status.is_success(), status.to_string());
        Ok(Self { status: status.into(), shown, is_success, body: serde_json::from_slice(&bytes).unwrap_or_default() })
    }

    fn refusal(&self) -> anyhow::Error {
        let told = |member: &str| self.body[member].as_str().unwrap_or_default().to_owned();
        anyhow!("the server answered {}: {}: {}", self.shown, told("title"), told("detail"))
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
