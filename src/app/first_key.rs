//! The key that a server begins with, and where one without keys may listen.

use std::net::SocketAddr;

use anyhow::{Context, bail};
use jiff::Timestamp;

use crate::access::{Issued, KeyState, KeyWish, Scope, Scopes};
use crate::config::Config;
use crate::http::Gate;
use crate::store::{Actor, Store, keys};

/// The gate as the database has it, once the key of `access.key_file` is in there.
///
/// # Errors
/// When that file holds no key, or when strangers could reach a server that lets everybody in.
pub(super) async fn gate(store: &Store, config: &Config, address: SocketAddr) -> anyhow::Result<Gate> {
    learn_key_file(store, config).await?;
    let gate = Gate::new(config.access.clone(), config.server.cors_origins.clone());
    gate.refresh(store).await?;
    if gate.is_open() && !address.ip().to_canonical().is_loopback() {
        let database = config.database.path.display();
        bail!(
            "server.listen: {address} is not loopback, and there is no key yet, so anybody who reaches it could use it; make \
             one first: headway keys create --scope admin --database {database}"
        );
    }
    if !address.ip().to_canonical().is_loopback() && !config.server.tls.is_on() {
        tracing::warn!(%address, "keys are sent as they are: set server.tls, or put a proxy with TLS in front");
    }
    Ok(gate)
}

async fn learn_key_file(store: &Store, config: &Config) -> anyhow::Result<()> {
    let path = &config.access.key_file;
    if path.as_os_str().is_empty() {
        return Ok(());
    }
    let shown = path.display();
    let text = std::fs::read_to_string(path).with_context(|| format!("access.key_file: cannot read {shown}"))?;
    let issued = Issued::read(text.trim_ascii()).with_context(|| {
        format!("access.key_file: {shown} holds no key: hw_, 16 hexadecimal digits, _, 43 characters of base64url")
    })?;
    let (key_id, now) = (issued.key_id, Timestamp::now());
    let stored = store.stored_keys().await?;
    match stored.iter().find(|stored| stored.key.key_id == key_id) {
        Some(stored) if stored.secret_sha256 != issued.secret_sha256 => {
            bail!("access.key_file: a key {key_id} with another secret part is known; let its 16 digits be others");
        }
        Some(stored) if stored.key.state(now) == KeyState::Revoked => {
            tracing::warn!(%key_id, "the key of access.key_file was revoked and stays so");
        }
        Some(_) => {}
        None => {
            let name = Some("access.key_file".to_owned());
            let wish = KeyWish { name, scopes: Scopes::from_iter([Scope::Admin]), ..KeyWish::default() };
            let mut transaction = store.begin_for(&Actor::local()).await?;
            keys::create(&mut transaction, &issued, &wish, config.access.max_keys, now)
                .await?
                .context("access.key_file")?;
            transaction.commit().await?;
            tracing::info!(%key_id, "the key of access.key_file is known now");
        }
    }
    Ok(())
}
