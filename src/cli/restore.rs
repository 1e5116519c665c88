//! `headway restore`: a backup in the place of a database.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::looking::Bar;
use super::waiting::block_on;
use crate::store::backup;

/// What `headway restore` can be told.
#[derive(Debug, Args)]
pub(super) struct RestoreArguments {
    /// The backup; it stays as it is
    #[arg(long, value_name = "FILE")]
    from: PathBuf,
    /// The database whose place it takes; no server may be running on it
    #[arg(long, value_name = "FILE")]
    database: PathBuf,
    /// Do not keep what was there beside it
    #[arg(long)]
    discard: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Verifies a backup and puts it in the place of a database.
#[expect(clippy::print_stdout, reason = "the result")]
pub(super) fn run(arguments: &RestoreArguments) -> anyhow::Result<()> {
    let bar = Bar::new();
    let RestoreArguments { from, database, discard, json } = arguments;
    let restored = block_on(backup::restore(from, database, !discard, &|looking| bar.show(looking)));
    bar.end();
    let (verified, kept) = restored?;
    if *json {
        let report = json!({"database": database, "from": from, "schema": verified.schema, "kept": kept});
        println!("{}", serde_json::to_string_pretty(&report)?);
        return Ok(());
    }
    println!("{} is now what {} holds, verified", database.display(), from.display());
    if let Some(kept) = kept {
        println!("what was there is kept as {}", kept.display());
    }
    Ok(())
}
