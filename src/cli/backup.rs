//! `headway backup`: a copy of a database, taken while a server may be writing to it.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use hyper::Method;
use serde_json::json;

use super::looking::Bar;
use super::service::ServerArguments;
use super::waiting::block_on;
use crate::store::backup;

/// What `headway backup` can be told.
#[derive(Debug, Args)]
pub(super) struct BackupArguments {
    /// The database file; a server may own it and write to it
    #[arg(long, value_name = "FILE", required_unless_present = "server", requires = "to")]
    database: Option<PathBuf>,
    /// The backup, a new file; a server writes into a folder of its own, `backup.folder`
    #[arg(long, value_name = "FILE", conflicts_with = "server")]
    to: Option<PathBuf>,
    /// Take the place of a file that is there
    #[arg(long, requires = "to")]
    force: bool,
    #[command(flatten)]
    server: ServerArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Takes a backup and verifies it.
#[expect(clippy::print_stdout, reason = "the result")]
pub(super) fn run(arguments: &BackupArguments) -> anyhow::Result<()> {
    let taken = match (arguments.server.service()?, &arguments.database, &arguments.to) {
        (Some(server), ..) => block_on(server.send(Method::POST, "/v1/backup", None))?,
        (None, Some(database), Some(to)) => {
            let bar = Bar::new();
            let taken = block_on(backup::backup(database, to, arguments.force, &|looking| bar.show(looking)));
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
