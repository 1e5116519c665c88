//! TLS from files, which are read again when they change.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use arc_swap::ArcSwap;
use serde::{Deserialize, Serialize};
use tokio::net::TcpStream;
use tokio::signal::unix::{SignalKind, signal};
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::{self, ServerConfig};
use tokio_rustls::server::TlsStream;

/// Where certificate and key are, and how patient the server is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TlsSettings {
    /// The certificate and those between it and a root, PEM; none: plain HTTP.
    pub certificate: PathBuf,
    /// Its private key, PEM.
    pub key: PathBuf,
    /// How long a client may take to agree on keys, s.
    pub handshake_s: f64,
    /// How often the files are looked at, s.
    pub look_s: f64,
}

impl TlsSettings {
    /// Whether connections are to be encrypted.
    #[must_use]
    pub fn is_on(&self) -> bool {
        !self.certificate.as_os_str().is_empty()
    }

    /// How the server's address begins.
    #[must_use]
    pub fn scheme(&self) -> &'static str {
        if self.is_on() { "https" } else { "http" }
    }
}

/// Why there is no TLS.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// One of the two without the other.
    #[error("server.tls: certificate and key belong together, and one of them is not set")]
    Half,
    /// A file cannot be read.
    #[error("server.tls: cannot read {}: {source}", path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file is not what it should be.
    #[error("server.tls: {} holds no usable {what}: {source}", path.display())]
    Pem {
        /// Which.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
        /// Why not.
        source: rustls::pki_types::pem::Error,
    },
    /// They do not go together.
    #[error("server.tls: certificate and key cannot be used: {0}")]
    Unusable(#[from] rustls::Error),
}

/// What encrypts new connections.
pub struct Tls {
    settings: TlsSettings,
    current: ArcSwap<Files>,
}

/// The files as they were read, and what was made of them.
struct Files {
    certificate: Vec<u8>,
    key: Vec<u8>,
    config: Arc<ServerConfig>,
}

impl fmt::Debug for Tls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tls").field("settings", &self.settings).finish_non_exhaustive()
    }
}

impl Tls {
    /// As the settings have it; `None` for plain HTTP.
    ///
    /// # Errors
    /// When the files cannot be used.
    pub fn load(settings: &TlsSettings) -> Result<Option<Arc<Self>>, TlsError> {
        if settings.is_on() == settings.key.as_os_str().is_empty() {
            return Err(TlsError::Half);
        }
        if !settings.is_on() {
            return Ok(None);
        }
        let current = ArcSwap::from_pointee(Files::read(settings)?);
        Ok(Some(Arc::new(Self { settings: settings.clone(), current })))
    }

    /// Reads the files again at SIGHUP, and when they have changed. Those that cannot be used change nothing.
    ///
    /// # Errors
    /// When the signal cannot be waited for.
    pub fn follow(self: &Arc<Self>) -> std::io::Result<impl Future<Output = ()> + use<>> {
        let mut told = signal(SignalKind::hangup())?;
        let mut looked = tokio::time::interval(Duration::from_secs_f64(self.settings.look_s));
        looked.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let tls = Arc::clone(self);
        Ok(async move {
            loop {
                let asked = tokio::select! {
                    _ = told.recv() => true,
                    _ = looked.tick() => false,
                };
                let look = Arc::clone(&tls);
                let changed = tokio::task::spawn_blocking(move || look.reload()).await;
                match changed {
                    Ok(Ok(true)) => tracing::info!("certificate and key were read again"),
                    Ok(Ok(false)) if asked => tracing::info!("certificate and key have not changed"),
                    Ok(Ok(false)) => {}
                    Ok(Err(error)) => tracing::error!(%error, "the certificate before stays in use"),
                    Err(error) => tracing::error!(%error, "certificate and key were not looked at"),
                }
            }
        })
    }

    /// Whether the files changed and are used from now on.
    fn reload(&self) -> Result<bool, TlsError> {
        let current = self.current.load();
        let [certificate, key] = [read(&self.settings.certificate)?, read(&self.settings.key)?];
        if current.certificate == certificate && current.key == key {
            return Ok(false);
        }
        self.current.store(Arc::new(Files::made_of(certificate, key, &self.settings)?));
        Ok(true)
    }

    /// Agrees with a client on keys.
    ///
    /// # Errors
    /// When the client does not, or takes too long.
    pub(super) async fn accept(&self, stream: TcpStream) -> std::io::Result<TlsStream<TcpStream>> {
        let acceptor = TlsAcceptor::from(Arc::clone(&self.current.load().config));
        let patience = Duration::from_secs_f64(self.settings.handshake_s);
        timeout(patience, acceptor.accept(stream)).await.unwrap_or_else(|_| Err(std::io::ErrorKind::TimedOut.into()))
    }
}

fn read(path: &PathBuf) -> Result<Vec<u8>, TlsError> {
    std::fs::read(path).map_err(|source| TlsError::Read { path: path.clone(), source })
}

impl Files {
    fn read(settings: &TlsSettings) -> Result<Self, TlsError> {
        Self::made_of(read(&settings.certificate)?, read(&settings.key)?, settings)
    }

    fn made_of(certificate: Vec<u8>, key: Vec<u8>, settings: &TlsSettings) -> Result<Self, TlsError> {
        let unusable = |path: &PathBuf, what| {
            let path = path.clone();
            move |source| TlsError::Pem { path, what, source }
        };
        let chain = CertificateDer::pem_slice_iter(&certificate)
            .collect::<Result<Vec<_>, _>>()
            .map_err(unusable(&settings.certificate, "certificate"))?;
        let private = PrivateKeyDer::from_pem_slice(&key).map_err(unusable(&settings.key, "private key"))?;
        let mut config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()?
            .with_no_client_auth()
            .with_single_cert(chain, private)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(Self { certificate, key, config: Arc::new(config) })
    }
}
