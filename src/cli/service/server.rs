//! A running server, spoken to over its interface, encrypted or not.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, anyhow};
use axum::body::Body;
use bytes::Bytes;
use clap::Args;
use http_body_util::combinators::UnsyncBoxBody;
use hyper::header::{AUTHORIZATION, HeaderValue};
use hyper::http::request::Builder;
use hyper::{Request, Response};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::client::legacy::Client;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::TokioExecutor;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::CertificateDer;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};

use super::Service;

/// Which server, and how it is spoken to.
#[derive(Debug, Args)]
pub(in crate::cli) struct ServerArguments {
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
    pub(in crate::cli) fn service(&self) -> anyhow::Result<Option<Service>> {
        let Some(url) = &self.server else { return Ok(None) };
        let from_file = match &self.key_file {
            None => None,
            Some(path) => {
                let text = std::fs::read_to_string(path);
                Some(text.with_context(|| format!("--key-file: cannot read {}", path.display()))?.trim().to_owned())
            }
        };
        let key = from_file.as_deref().or(self.key.as_deref());
        Ok(Some(Service::Server(Box::new(Server::new(url, key, self.ca.as_deref())?))))
    }
}

/// A server, and the key that it is shown.
pub(in crate::cli) struct Server {
    http: Client<HttpsConnector<HttpConnector>, UnsyncBoxBody<Bytes, io::Error>>,
    url: String,
    authorization: Option<HeaderValue>,
}

impl Server {
    /// The server at `url`, whose certificate is to be one of those in `ca`, or from there; else one that the system trusts.
    pub(super) fn new(url: &str, key: Option<&str>, ca: Option<&Path>) -> anyhow::Result<Self> {
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

    /// The request with the server's address and the key.
    pub(super) fn address(&self, request: Builder, path: &str) -> Builder {
        let request = request.uri(format!("{}{path}", self.url));
        match &self.authorization {
            Some(bearer) => request.header(AUTHORIZATION, bearer),
            None => request,
        }
    }

    pub(super) async fn exchange(
        &self,
        request: Request<UnsyncBoxBody<Bytes, io::Error>>,
    ) -> anyhow::Result<Response<Body>> {
        let response = self.http.request(request).await;
        let response =
            response.with_context(|| format!("cannot speak to {}: does a server listen there?", self.url))?;
        Ok(response.map(Body::new))
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
