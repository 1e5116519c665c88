//! What most commands are told: of which model, where, and how it is to be answered.

use std::io::Write;

use clap::Args;
use serde_json::Value;

use super::place::Place;
use crate::lineage::ModelName;

/// A database or a server as a whole.
#[derive(Debug, Args)]
pub(super) struct Somewhere {
    #[command(flatten)]
    pub(super) place: Place,
    /// Print JSON instead of tables
    #[arg(long)]
    pub(super) json: bool,
}

/// A model somewhere.
#[derive(Debug, Args)]
pub(super) struct Asked {
    /// Which model
    #[arg(long, value_name = "NAME", default_value = "default", value_parser = ModelName::parse)]
    pub(super) model: ModelName,
    #[command(flatten)]
    pub(super) place: Place,
    /// Print JSON instead of tables
    #[arg(long)]
    pub(super) json: bool,
}

impl Asked {
    /// A path under the model's.
    pub(super) fn path(&self, under: &str) -> String {
        format!("/v1/models/{}{under}", self.model)
    }

    /// Prints an answer as it is, or what a person reads instead.
    pub(super) fn print(&self, answer: &Value, told: impl FnOnce() -> String) -> anyhow::Result<()> {
        print(self.json, answer, told)
    }
}

/// Prints JSON where it is asked for, or what a person reads instead.
pub(super) fn print(json: bool, answer: &Value, told: impl FnOnce() -> String) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    if json {
        writeln!(out, "{}", serde_json::to_string_pretty(answer)?)?;
    } else {
        writeln!(out, "{}", told())?;
    }
    Ok(out.flush()?)
}
