//! `headway backup`: a copy of a database, taken while a server may be writing to it.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use hyper::Method;
use serde_json::json;

use super::looking::Bar;
use super::remote::Remote;
use crate::store::backup;

/// What `headway backup` can be told.
#[derive(Debug, Args)]
pub(super) struct BackupArguments {
    /// The database file; a server may own it and write to it
    #[arg(long, value_name = "FILE", required_unless_present = "server", requires = "to")]
    database: Option<PathBuf>,
    /// The backup, a new file
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
    /// Take the place of a file that is there
    #[arg(long, requires = "to")]
    force: bool,
    /// Have the server at this address write the backup into its own folder, `backup.folder`
    #[arg(long, value_name = "URL", conflicts_with_all = ["database", "to"])]
    server: Option<String>,
    /// The key that is shown to the server
    #[arg(long, value_name = "KEY", env = "HEADWAY_KEY", hide_env_values = true)]
    key: Option<String>,
    /// Certificates (PEM) that vouch for the server's [default: those that the system trusts]
    #[arg(long, value_name = "FILE", requires = "server")]
    ca: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Takes a backup and verifies it.
#[expect(clippy::print_stdout, reason = "the result")]
pub(super) fn run(arguments: &BackupArguments) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let taken = match (&arguments.server, &arguments.database, &arguments.to) {
        (Some(url), ..) => {
            let server = Remote::new(url, arguments.key.as_deref(), arguments.ca.as_deref())?;
            runtime.block_on(server.send(Method::POST, "/v1/backup", None))?
        }
        (None, Some(database), Some(to)) => {
            let bar = Bar::new();
            let taken = runtime.block_on(backup::backup(database, to, arguments.force, &|looking| bar.show(looking)));
            bar.end();
            let schema = taken?.schema;
            json!({"name": to, "bytes": std::fs::metadata(to)?.len(), "schema": schema})
        }
        _ => bail!("--database FILE --to FILE, or --server URL"),
    };
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&taken)?);
    } else {
        println!("{}, {} bytes, verified", taken["name"].as_str().unwrap_or_default(), taken["bytes"]);
    }
    Ok(())
}
