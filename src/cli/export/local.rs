//! Out of a database that no server has open.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, bail};

use crate::cli::settings;
use crate::config::Config;
use crate::formats::{EventWriter, SheetFormat};
use crate::lineage::ModelName;
use crate::store::Store;
use crate::store::contents::Contents;

/// Writes what a batch holds.
pub(super) async fn events(
    database: Option<&Path>,
    model: &ModelName,
    batch: &str,
    table: Option<SheetFormat>,
    file: &mut File,
) -> anyhow::Result<()> {
    let Config { database, .. } = settings::of_a_server(database)?;
    if !database.path.exists() {
        bail!("there is no database {}", database.path.display());
    }
    let store = Store::open(&database).await?;
    let model = store.model(model).await?.with_context(|| format!("there is no model {model}"))?;
    let id = batch.strip_prefix('b').and_then(|id| id.parse().ok()).context("--batch is b1, or b2, and so on")?;
    let known = store.batch(model.model_id, id).await?;
    let known = known.with_context(|| format!("{} has no batch {batch}", model.name))?;
    let (mut contents, mut writer) = (Contents::of(known.batch_id), EventWriter::new(table)?);
    while !contents.have_ended() {
        let events = contents.read(&store).await?;
        file.write_all(&writer.write(&events)?)?;
    }
    file.write_all(&writer.end()?)?;
    store.close().await;
    Ok(())
}
