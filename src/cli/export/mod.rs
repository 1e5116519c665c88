//! `headway export`: events, evaluations and versions into files, as a server hands them out; events also out of a database
//! that nobody serves.

use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use serde_json::json;
use tempfile::NamedTempFile;

use super::asked::block_on;
use super::place::Place;
use super::service::Opened;
use crate::lineage::ModelName;

/// What `headway export` can be told.
#[derive(Debug, Args)]
pub(super) struct ExportArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// What a batch holds, as an upload takes it: .ndjson, .csv or .parquet.
    Events(EventsArguments),
    /// How a version drives, a row a regime: .json, .csv or .parquet.
    Evaluation(VersionArguments),
    /// A version as a file: .safetensors, .onnx, or as vehicle types of SUMO (--format sumo).
    Version(VersionArguments),
}

#[derive(Debug, Args)]
struct EventsArguments {
    /// Which batch: b1, and so on
    #[arg(long, value_name = "BATCH")]
    batch: String,
    #[command(flatten)]
    common: Common,
}

#[derive(Debug, Args)]
struct VersionArguments {
    /// Which version
    #[arg(long, value_name = "NUMBER")]
    version: u64,
    #[command(flatten)]
    common: Common,
}

#[derive(Debug, Args)]
struct Common {
    /// Of which model
    #[arg(long, value_name = "NAME", default_value = "default", value_parser = ModelName::parse)]
    model: ModelName,
    /// The file that is written; its name says in what form, unless --format does
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// In what form
    #[arg(long, value_name = "NAME")]
    format: Option<String>,
    #[command(flatten)]
    place: Place,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Writes the file.
///
/// # Errors
/// When it cannot be made; nothing is left under its name then, or what was there before.
pub(super) fn run(arguments: &ExportArguments) -> anyhow::Result<()> {
    block_on(export(&arguments.what))
}

async fn export(what: &What) -> anyhow::Result<()> {
    let (common, thing, forms): (_, _, &[&str]) = match what {
        What::Events(EventsArguments { batch, common }) => {
            (common, format!("batches/{batch}/events"), &["ndjson", "csv", "parquet"])
        }
        What::Evaluation(VersionArguments { version, common }) => {
            (common, format!("versions/{version}/evaluation"), &["json", "csv", "parquet"])
        }
        What::Version(VersionArguments { version, common }) => {
            (common, format!("versions/{version}/artifact"), &["safetensors", "onnx", "sumo"])
        }
    };
    let form = match &common.format {
        Some(named) => *forms
            .iter()
            .find(|form| *form == named)
            .with_context(|| format!("--format is one of {}", forms.join(", ")))?,
        None => form(&common.out, forms)?,
    };
    let mut file = beside(&common.out)?;
    let path = format!("/v1/models/{}/{thing}?format={form}", common.model);
    let service = common.place.service(Opened::Known).await?;
    let written = service.download(&path, file.as_file_mut()).await;
    service.close().await;
    written?;
    file.as_file_mut().flush()?;
    file.as_file().sync_all()?;
    let bytes = file.as_file().metadata()?.len();
    file.persist(&common.out).with_context(|| format!("cannot write {}", common.out.display()))?;
    let shown = common.out.display().to_string();
    let mut told = std::io::stdout();
    if common.json {
        writeln!(told, "{}", json!({"file": shown, "format": form, "bytes": bytes}))?;
    } else {
        writeln!(told, "{shown}: {bytes} bytes")?;
    }
    Ok(())
}

/// The form that the file's name says.
fn form<'f>(out: &Path, forms: &[&'f str]) -> anyhow::Result<&'f str> {
    let extension = out.extension().and_then(OsStr::to_str).unwrap_or_default();
    match forms.iter().find(|form| **form == extension) {
        Some(form) => Ok(form),
        None => bail!("the name of --out is to end in one of .{}", forms.join(", .")),
    }
}

/// A file in the same folder, which gets the name when it is whole.
fn beside(out: &Path) -> anyhow::Result<NamedTempFile> {
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    NamedTempFile::new_in(folder).with_context(|| format!("cannot write into {}", folder.display()))
}
