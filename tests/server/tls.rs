use std::fs::File;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rcgen::{CertifiedKey, generate_simple_self_signed};
use serde_json::Value;
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::{ClientConfig, RootCertStore};

use crate::support::binary::Binary;

/// Writes a new certificate for this machine, and its key.
fn certify(directory: &Path) {
    let names = ["localhost".to_owned(), "127.0.0.1".to_owned()];
    let CertifiedKey { cert, signing_key } = generate_simple_self_signed(names).unwrap();
    std::fs::write(directory.join("certificate.pem"), cert.pem()).unwrap();
    std::fs::write(directory.join("key.pem"), signing_key.serialize_pem()).unwrap();
}

/// The real binary, encrypted.
struct Encrypted {
    directory: TempDir,
    binary: Binary,
}

impl Encrypted {
    fn start() -> Self {
        Self::start_with(&[])
    }

    fn start_with(settings: &[&str]) -> Self {
        let directory = tempfile::tempdir().unwrap();
        certify(directory.path());
        let file = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
        let certificate = format!("server.tls.certificate={}", file("certificate.pem"));
        let key = format!("server.tls.key={}", file("key.pem"));
        let place = ["--listen", "127.0.0.1:0", "--database", &file("headway.db")];
        let arguments = [&place[..], &["--set", &certificate, "--set", &key], settings].concat();
        let binary = Binary::start_with_log(&arguments, "", File::create(file("log")).unwrap());
        Self { directory, binary }
    }

    fn keys(&self, arguments: &[&str]) -> Output {
        let ca = self.directory.path().join("certificate.pem");
        let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
        command
            .env_remove("HEADWAY_KEY")
            .arg("keys")
            .args(arguments)
            .args(["--server", &self.binary.url, "--ca"])
            .arg(ca);
        command.output().unwrap()
    }

    fn address(&self) -> &str {
        self.binary.url.strip_prefix("https://").unwrap()
    }

    /// A connection that trusts this certificate, or why there is none.
    async fn connect(&self, trusted: &[u8]) -> std::io::Result<TlsStream<TcpStream>> {
        let mut roots = RootCertStore::empty();
        roots.add(CertificateDer::from_pem_slice(trusted).unwrap()).unwrap();
        let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_root_certificates(roots)
            .with_no_client_auth();
        let stream = TcpStream::connect(self.address()).await.unwrap();
        TlsConnector::from(Arc::new(config)).connect(ServerName::try_from("localhost").unwrap(), stream).await
    }
}

#[tokio::test]
async fn connections_are_encrypted_with_the_certificate_from_a_file() {
    let server = Encrypted::start();
    assert!(server.binary.url.starts_with("https://127.0.0.1:"), "{}", server.binary.url);
    let made = server.keys(&["create", "--scope", "admin"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let key = String::from_utf8(made.stdout).unwrap();
    let listed = server.keys(&["list", "--json", "--key", key.trim()]);
    let listed: Value = serde_json::from_slice(&listed.stdout).unwrap();
    assert_eq!(listed["keys"][0]["key_id"], key[3..19]);

    let certificate = std::fs::read(server.directory.path().join("certificate.pem")).unwrap();
    let mut stream = server.connect(&certificate).await.unwrap();
    stream.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n").await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    assert!(answer.starts_with("HTTP/1.1 200 ") && answer.contains("strict-transport-security: max-age="), "{answer}");

    // Who speaks plainly is told nothing.
    let mut stream = TcpStream::connect(server.address()).await.unwrap();
    stream.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\n\r\n").await.unwrap();
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer).await;
    assert!(!answer.windows(4).any(|window| window == b"HTTP"), "{answer:?}");
}

#[tokio::test]
async fn files_that_have_changed_are_used_by_themselves_and_those_that_cannot_be_are_told_of() {
    let server = Encrypted::start_with(&["--set", "server.tls.look_s=0.05"]);
    let [path, key] = ["certificate.pem", "key.pem"].map(|name| server.directory.path().join(name));
    let [before, own_key] = [&path, &key].map(|file| std::fs::read(file).unwrap());
    let refused = || {
        let log = std::fs::read_to_string(server.directory.path().join("log")).unwrap();
        log.matches("the certificate before stays in use").count()
    };
    certify(server.directory.path());
    let [after, after_key] = [&path, &key].map(|file| std::fs::read(file).unwrap());
    let patience = Instant::now() + Duration::from_mins(1);
    while server.connect(&after).await.is_err() {
        assert!(Instant::now() < patience, "the new certificate is not used");
    }
    // No certificate, a cut one, one without its key, none there.
    let cut = &before[..before.len() / 2];
    for (certificate, key_of) in
        [(Some(&b"none"[..]), &own_key), (Some(cut), &own_key), (Some(&before), &after_key), (None, &own_key)]
    {
        match certificate {
            Some(text) => std::fs::write(&path, text).unwrap(),
            None => std::fs::remove_file(&path).unwrap(),
        }
        std::fs::write(&key, key_of).unwrap();
        let so_far = refused();
        // Whichever look finds them half changed, the second from now finds them as they are.
        while refused() < so_far + 2 {
            assert!(Instant::now() < patience, "nothing is said of {certificate:?}");
            tokio::task::yield_now().await;
        }
        server.connect(&after).await.unwrap();
    }
    std::fs::write(&path, &before).unwrap();
    while server.connect(&before).await.is_err() {
        assert!(Instant::now() < patience, "the certificate that is back is not used");
    }
}

#[tokio::test]
async fn a_new_certificate_is_used_after_sighup_and_a_bad_one_is_not() {
    let server = Encrypted::start();
    let path = server.directory.path().join("certificate.pem");
    let before = std::fs::read(&path).unwrap();
    let hang_up = || {
        let pid = server.binary.pid().to_string();
        assert!(Command::new("kill").args(["-HUP", &pid]).status().unwrap().success());
    };
    std::fs::write(&path, "no certificate").unwrap();
    hang_up();
    server.connect(&before).await.unwrap();
    certify(server.directory.path());
    let after = std::fs::read(&path).unwrap();
    assert_ne!(before, after);
    hang_up();
    let patience = Instant::now() + Duration::from_mins(1);
    while server.connect(&after).await.is_err() {
        assert!(Instant::now() < patience, "the new certificate is not used");
    }
    assert!(server.connect(&before).await.is_err(), "the certificate before is not used any more");
}

/// What the health check of a container says of a server that the environment does not describe but for its address.
fn check_health(url: &str) -> Output {
    let address = url.split_once("://").unwrap().1;
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    command.arg("healthy").env("HEADWAY_SERVER__LISTEN", address).output().unwrap()
}

#[test]
fn the_health_check_finds_a_server_that_encrypts_and_asks_for_keys_and_one_that_does_not() {
    let server = Encrypted::start();
    assert!(server.keys(&["create", "--scope", "admin"]).status.success());
    assert!(!server.keys(&["list"]).status.success(), "it asks for a key");
    let plain = server.directory.path().join("plain.db");
    let plain = Binary::start(&["--listen", "127.0.0.1:0", "--database", plain.to_str().unwrap()]);
    for url in [&server.binary.url, &plain.url] {
        let healthy = check_health(url);
        assert!(healthy.status.success(), "{url}: {}", String::from_utf8_lossy(&healthy.stderr));
        let command = [env!("CARGO_BIN_EXE_headway"), "healthy", "--server", url];
        assert!(Command::new(command[0]).args(&command[1..]).status().unwrap().success(), "{url}");
    }
    let url = server.binary.url.clone();
    drop(server);
    let gone = check_health(&url);
    assert_eq!(gone.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&gone.stderr).contains("cannot speak to"), "{gone:?}");
}

#[test]
fn half_of_the_files_and_files_of_something_else_are_refused_at_the_start() {
    let directory = tempfile::tempdir().unwrap();
    certify(directory.path());
    let file = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let [certificate, key] = [file("certificate.pem"), file("key.pem")];
    for (certificate, key, why) in [
        (certificate.as_str(), "", "belong together"),
        ("", key.as_str(), "belong together"),
        (certificate.as_str(), certificate.as_str(), "no usable private key"),
        (certificate.as_str(), "absent.pem", "cannot read absent.pem"),
    ] {
        let refused = Command::new(env!("CARGO_BIN_EXE_headway"))
            .args(["--listen", "127.0.0.1:0", "--database", &file("headway.db")])
            .args(["--set", &format!("server.tls.certificate={certificate}")])
            .args(["--set", &format!("server.tls.key={key}")])
            .output()
            .unwrap();
        let message = String::from_utf8(refused.stderr).unwrap();
        assert!(!refused.status.success() && message.contains(why), "{message}");
    }
}
