//! `headway export`: events, evaluations and versions into files, as a server hands them out.

use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use serde_json::json;
use tempfile::NamedTempFile;

use super::asked::Asked;
use super::service::Opened;

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
    /// The file that is written; its name says in what form, unless --format does
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// In what form
    #[arg(long, value_name = "NAME")]
    format: Option<String>,
    #[command(flatten)]
    asked: Asked,
}

/// Writes the file.
///
/// # Errors
/// When it cannot be made; nothing is left under its name then, or what was there before.
pub(super) fn run(arguments: &ExportArguments) -> anyhow::Result<()> {
    let (common, thing, forms): (_, _, &[&str]) = match &arguments.what {
        What::Events(EventsArguments { batch, common }) => {
            (common, format!("/batches/{batch}/events"), &["ndjson", "csv", "parquet"])
        }
        What::Evaluation(VersionArguments { version, common }) => {
            (common, format!("/versions/{version}/evaluation"), &["json", "csv", "parquet"])
        }
        What::Version(VersionArguments { version, common }) => {
            (common, format!("/versions/{version}/artifact"), &["safetensors", "onnx", "sumo"])
        }
    };
    let Common { out, format, asked } = common;
    let form = form(out, format.as_deref(), forms)?;
    let mut file = beside(out)?;
    let path = asked.path(&format!("{thing}?format={form}"));
    asked.place.ask(Opened::Known, async |service| service.download(&path, file.as_file_mut()).await)?;
    file.as_file_mut().flush()?;
    file.as_file().sync_all()?;
    let bytes = file.as_file().metadata()?.len();
    file.persist(out).with_context(|| format!("cannot write {}", out.display()))?;
    asked.print(&json!({"file": out, "format": form, "bytes": bytes}), || format!("{}: {bytes} bytes", out.display()))
}

/// The form that is named, else the one that the file's name says.
fn form<'f>(out: &Path, named: Option<&str>, forms: &[&'f str]) -> anyhow::Result<&'f str> {
    let extension = out.extension().and_then(OsStr::to_str).unwrap_or_default();
    match (forms.iter().find(|form| **form == named.unwrap_or(extension)), named) {
        (Some(form), _) => Ok(form),
        (None, Some(_)) => bail!("--format is one of {}", forms.join(", ")),
        (None, None) => bail!("the name of --out is to end in one of .{}", forms.join(", .")),
    }
}

/// A file in the same folder, which gets the name when it is whole.
fn beside(out: &Path) -> anyhow::Result<NamedTempFile> {
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    NamedTempFile::new_in(folder).with_context(|| format!("cannot write into {}", folder.display()))
}
