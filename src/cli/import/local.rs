//! Into a database that no server has open.

use std::io::Read;
use std::path::Path;

use anyhow::Context;
use jiff::Timestamp;
use serde_json::json;

use super::report::Outcome;
use crate::cli::looking::Bar;
use crate::cli::settings;
use crate::config::Config;
use crate::http::receipt_body;
use crate::ingest::{self, IngestError, IngestSettings, Received, Spool, SpoolError, Spooled, receive};
use crate::lineage::{Model, ModelName};
use crate::store::{Actor, Store, selection};

/// Bytes read at once.
const CHUNK_BYTES: usize = 512 << 10;

/// A database, opened for this command alone, and the model that takes events.
pub(super) struct Database {
    store: Store,
    ingest: IngestSettings,
    model: Model,
}

impl Database {
    /// Opens it, with the settings that a server would find; a new one has the model `default`, as a server would make it.
    pub(super) async fn open(path: Option<&Path>, model: &ModelName) -> anyhow::Result<Self> {
        let Config { database, ingest, model: defaults, .. } = settings::of_a_server(path)?;
        let store = Store::open(&database).await?;
        store.ensure_default_model(&defaults).await?;
        let model = store.model(model).await?.with_context(|| format!("there is no model {model}"))?;
        Ok(Self { store, ingest, model })
    }

    /// Stores what is in the file, and makes the tasks that are due then; a server that starts later runs them.
    pub(super) async fn take(&self, upload: super::Upload<'_>, bar: &Bar) -> anyhow::Result<Outcome> {
        let body = match self.spooled(&upload, bar) {
            Ok(body) => body,
            Err(error @ SpoolError::TooLarge { .. }) => return Ok(refused("body_too_large", &error)),
            Err(error) => return Err(error.into()),
        };
        let super::Upload { format, encoding, options, .. } = upload;
        let (model_id, model, received_at) = (self.model.model_id, self.model.settings.clone(), Timestamp::now());
        let upload = ingest::Upload { model_id, model, format, encoding, options, body, received_at };
        let received = match receive(&self.store, &Actor::local(), upload, &self.ingest).await {
            Ok(received) => received,
            Err(IngestError::Format(error)) if error.code() != "internal" => return Ok(refused(error.code(), &error)),
            Err(IngestError::Option(error)) => return Ok(refused(error.code, &error)),
            Err(error) => return Err(error.into()),
        };
        let Received { mut transaction, receipt } = received;
        let tasks =
            selection::create_due(&mut transaction, model_id, self.model.settings.schedule, received_at).await?;
        transaction.commit().await?;
        Ok(Outcome::of_receipt(receipt_body(&receipt, &tasks), receipt.holds_nothing()))
    }

    /// The file's bytes, kept as they are now.
    fn spooled(&self, upload: &super::Upload<'_>, bar: &Bar) -> Result<Spooled, SpoolError> {
        let mut spool = Spool::create(&self.ingest, self.ingest.max_body_bytes)?;
        let (mut chunk, mut file, mut read) = (vec![0; CHUNK_BYTES], &upload.file, 0);
        let name = upload.path.display().to_string();
        loop {
            let bytes = file.read(&mut chunk)?;
            if bytes == 0 {
                return Ok(spool.finish());
            }
            spool.write(&chunk[..bytes])?;
            read += bytes as u64;
            bar.share(&name, read as f64 / upload.bytes.max(read) as f64);
        }
    }

    pub(super) async fn close(self) {
        self.store.close().await;
    }
}

fn refused(code: &str, error: &impl ToString) -> Outcome {
    Outcome::Refused(json!({"code": code, "detail": error.to_string()}))
}
