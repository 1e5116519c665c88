//! `headway compact`: a database without what it does not use.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use crate::config::{Config, Layer};
use crate::store::Store;

/// What `headway compact` can be told.
#[derive(Debug, Args)]
pub(super) struct CompactArguments {
    /// The database file
    #[arg(long, value_name = "FILE", default_value = "./headway.db")]
    database: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// Rewrites the database.
pub(super) fn run(arguments: &CompactArguments) -> anyhow::Result<()> {
    let path = &arguments.database;
    anyhow::ensure!(path.exists(), "there is no database {}", path.display());
    let name = path.to_str().context("--database: the path is not UTF-8")?;
    let settings = Config::resolve([Layer::string("--database", "database.path", name)])?.database;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (before, after) = runtime.block_on(async {
        let store = Store::open(&settings).await?;
        let before = store.size().await?;
        store.compact().await?;
        let after = store.size().await?;
        store.close().await;
        anyhow::Ok((before.database, after.database))
    })?;
    let told = if arguments.json {
        serde_json::json!({"before_bytes": before, "after_bytes": after}).to_string()
    } else {
        format!("{}: {before} bytes before, {after} bytes after", path.display())
    };
    writeln!(std::io::stdout(), "{told}")?;
    Ok(())
}
