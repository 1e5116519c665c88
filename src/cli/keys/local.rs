//! Keys of a database that no server has open.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, bail};
use jiff::Timestamp;
use serde_json::{Value, json};

use crate::access::{Issued, KeyId, KeyWish};
use crate::cli::settings;
use crate::config::Config;
use crate::http::key_body;
use crate::store::keys::{self, Revoked};
use crate::store::{Actor, Store};

/// Keys read at once.
const PAGE: u32 = 1000;

/// A database, opened for this command alone.
pub(super) struct Database {
    store: Store,
    max_keys: u32,
}

impl Database {
    /// Opens it, with the settings that a server would find; a new one only to make a key.
    pub(super) async fn open(path: Option<&Path>, create: bool) -> anyhow::Result<Self> {
        let Config { database, access, .. } = settings::of_a_server(path)?;
        if !create && !database.path.exists() {
            bail!("there is no database {}", database.path.display());
        }
        Ok(Self { store: Store::open(&database).await?, max_keys: access.max_keys })
    }

    pub(super) async fn create(&self, wish: &KeyWish) -> anyhow::Result<Value> {
        let (issued, now) = (Issued::draw()?, Timestamp::now());
        let mut transaction = self.store.begin_for(&Actor::local()).await?;
        let key = keys::create(&mut transaction, &issued, wish, self.max_keys, now).await??;
        let managed = keys::admin_is_active(&mut transaction, now).await?;
        transaction.commit().await?;
        if !managed {
            let why = "no admin key is active: until there is one, keys are managed here alone, while no server runs";
            writeln!(std::io::stderr(), "{why}")?;
        }
        let mut made = key_body(&key, now);
        made["key"] = json!(issued.reveal());
        Ok(made)
    }

    pub(super) async fn list(&self) -> anyhow::Result<Vec<Value>> {
        let (mut listed, mut after, now) = (Vec::new(), 0, Timestamp::now());
        loop {
            let page = self.store.keys(after, PAGE).await?;
            let Some(&(last, _)) = page.last() else { return Ok(listed) };
            listed.extend(page.iter().map(|(_, key)| key_body(key, now)));
            after = last;
        }
    }

    pub(super) async fn revoke(&self, key_id: &str, force: bool) -> anyhow::Result<Value> {
        let now = Timestamp::now();
        let id = KeyId::parse(key_id).with_context(|| format!("{key_id:?} is no key's id: 16 hexadecimal digits"))?;
        let mut transaction = self.store.begin_for(&Actor::local()).await?;
        match keys::revoke(&mut transaction, id, force, now).await? {
            Revoked::Done(key) => {
                transaction.commit().await?;
                Ok(key_body(&key, now))
            }
            Revoked::Unknown => bail!("there is no key {id}"),
            Revoked::LastAdmin => bail!("{id} is the last active admin key; --force revokes it all the same"),
        }
    }

    pub(super) async fn close(self) {
        self.store.close().await;
    }
}
