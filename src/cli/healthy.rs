//! `headway healthy`: whether a server on this machine can serve, for the health check of a container.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use bytes::Bytes;
use clap::Args;
use http_body_util::Empty;
use hyper::Request;
use hyper_rustls::HttpsConnectorBuilder;
use hyper_util::client::legacy::Client;
use hyper_util::rt::TokioExecutor;
use tokio_rustls::rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use tokio_rustls::rustls::crypto::{CryptoProvider, ring, verify_tls12_signature, verify_tls13_signature};
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use tokio_rustls::rustls::{ClientConfig, DigitallySignedStruct, Error, SignatureScheme};

use super::settings;
use super::waiting::block_on;

/// What `headway healthy` can be told.
#[derive(Debug, Args)]
pub(super) struct HealthyArguments {
    /// Where the server listens [default: what the settings of this environment say, encrypted or not]
    #[arg(long, value_name = "URL")]
    server: Option<String>,
    /// How long it may take to answer, s
    #[arg(long, value_name = "SECONDS", default_value_t = 2.5, value_parser = seconds)]
    within: f64,
}

fn seconds(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|s| (0.01..=3600.0).contains(s)).ok_or_else(|| "0.01 to 3600 are taken".to_owned())
}

/// Fails unless the server answers `/readyz` with 200.
pub(super) fn run(arguments: &HealthyArguments) -> anyhow::Result<()> {
    let places = match &arguments.server {
        Some(url) => vec![url.trim_end_matches('/').to_owned()],
        None => places()?.to_vec(),
    };
    let within = Duration::from_secs_f64(arguments.within);
    block_on(async {
        tokio::time::timeout(within, ready(&places)).await.with_context(|| format!("no answer within {within:?}"))?
    })
}

/// Where a server with the settings of this environment listens, in the likelier way first. What its command line said is not
/// known here, so the other way is tried as well: whoever is spoken to in the wrong one hangs up.
fn places() -> anyhow::Result<[String; 2]> {
    let server = settings::of_a_server(None)?.server;
    let listen = SocketAddr::new(reachable(server.listen.ip()), server.listen.port());
    let schemes = if server.tls.is_on() { ["https", "http"] } else { ["http", "https"] };
    Ok(schemes.map(|scheme| format!("{scheme}://{listen}")))
}

/// Where on this machine somebody is found who listens on `address`.
fn reachable(address: IpAddr) -> IpAddr {
    match address {
        IpAddr::V4(any) if any.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(any) if any.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        one => one,
    }
}

async fn ready(places: &[String]) -> anyhow::Result<()> {
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()?
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(AnyCertificate(ring::default_provider())))
        .with_no_client_auth();
    let connector = HttpsConnectorBuilder::new().with_tls_config(config).https_or_http().enable_http1().build();
    let http = Client::builder(TokioExecutor::new()).build::<_, Empty<Bytes>>(connector);
    let mut unheard = Vec::new();
    for place in places {
        let request = Request::get(format!("{place}/readyz")).body(Empty::new()).context("--server is no URL")?;
        match http.request(request).await {
            Ok(answer) if answer.status() == 200 => return Ok(()),
            // Who speaks another way than this may answer that it is a bad request.
            Ok(answer) if answer.status() != 400 => bail!("{place}/readyz answers {}", answer.status()),
            Ok(answer) => unheard.push(format!("{place}/readyz answers {}", answer.status())),
            Err(error) => unheard.push(format!("cannot speak to {place}: {:#}", anyhow::Error::from(error))),
        }
    }
    bail!(unheard.join("; "))
}

/// Takes whatever certificate the server shows: it is for a name by which others reach it, and nothing that it is told or says
/// here is a secret.
#[derive(Debug)]
struct AnyCertificate(CryptoProvider);

impl ServerCertVerifier for AnyCertificate {
    fn verify_server_cert(
        &self,
        _: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        verify_tls12_signature(message, certificate, signed, &self.0.signature_verification_algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        verify_tls13_signature(message, certificate, signed, &self.0.signature_verification_algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.0.signature_verification_algorithms.supported_schemes()
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn who_listens_everywhere_is_found_on_loopback() {
        for (listens, found) in [("0.0.0.0", "127.0.0.1"), ("::", "::1"), ("192.0.2.7", "192.0.2.7")] {
            assert_eq!(reachable(listens.parse().unwrap()), found.parse::<IpAddr>().unwrap());
        }
    }

    #[test]
    fn who_answers_that_he_cannot_serve_is_not_healthy() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let server = Some(format!("http://{}", listener.local_addr().unwrap()));
        let answering = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let _ = stream.read(&mut [0; 1024]).unwrap();
            stream.write_all(b"HTTP/1.1 503 Service Unavailable\r\ncontent-length: 0\r\n\r\n").unwrap();
        });
        let told = run(&HealthyArguments { server, within: 60.0 }).unwrap_err().to_string();
        assert!(told.ends_with("/readyz answers 503 Service Unavailable"), "{told}");
        answering.join().unwrap();
    }
}
