//! `headway promote` and `headway rollback`: which version serves.

use clap::Args;
use serde_json::{Value, json};

use super::asked::Asked;
use super::member::text;
use super::service::Opened;

/// What `headway promote` can be told.
#[derive(Debug, Args)]
pub(super) struct PromoteArguments {
    /// The version that is to serve
    #[arg(value_name = "VERSION")]
    version: u64,
    #[command(flatten)]
    why: Why,
}

/// What `headway rollback` can be told.
#[derive(Debug, Args)]
pub(super) struct RollbackArguments {
    /// The version to go back to [default: the parent of the one that serves]
    #[arg(value_name = "VERSION")]
    version: Option<u64>,
    #[command(flatten)]
    why: Why,
}

#[derive(Debug, Args)]
struct Why {
    /// What the history is to say of it
    #[arg(long, value_name = "TEXT")]
    reason: String,
    /// Also a version that learned what was retracted since
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    asked: Asked,
}

/// Lets a version serve.
pub(super) fn promote(arguments: &PromoteArguments) -> anyhow::Result<()> {
    make_move("/promote", Some(arguments.version), &arguments.why)
}

/// Goes back to a version.
pub(super) fn rollback(arguments: &RollbackArguments) -> anyhow::Result<()> {
    make_move("/rollback", arguments.version, &arguments.why)
}

fn make_move(way: &str, version: Option<u64>, why: &Why) -> anyhow::Result<()> {
    let Why { reason, force, asked } = why;
    let wish = json!({"version": version, "reason": reason, "force": force});
    let moved: Value = asked.place.ask(Opened::Known, async |service| service.post(&asked.path(way), &wish).await)?;
    asked.print(&moved, || {
        let [from, live, head] = ["from", "live", "head"].map(|member| text(&moved[member]));
        let from = if from.is_empty() { String::new() } else { format!(" instead of {from}") };
        format!("version {live} of {} serves{from}, and learning goes on from version {head}", asked.model)
    })
}
