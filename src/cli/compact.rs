//! `headway compact`: a database without what it does not use.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::settings;
use super::waiting::block_on;
use crate::store::Store;

/// What `headway compact` can be told.
#[derive(Debug, Args)]
pub(super) struct CompactArguments {
    /// The database file [default: ./headway.db]
    #[arg(long, value_name = "FILE")]
    database: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// Rewrites the database.
pub(super) fn run(arguments: &CompactArguments) -> anyhow::Result<()> {
    let settings = settings::of_a_server(arguments.database.as_deref())?.database;
    let path = &settings.path;
    anyhow::ensure!(path.exists(), "there is no database {}", path.display());
    let (before, after) = block_on(async {
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
