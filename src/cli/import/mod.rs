//! `headway import`: event files into a model, as an upload takes them, in a database that nobody serves or at a server.

/// Of a database that no server owns.
mod local;
/// Of a server, over its interface.
mod remote;
/// What came of it, for people and for programs.
mod report;

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::looking::Bar;
use super::place::Place;
use crate::formats::{Encoding, Format, Preset};
use crate::ingest::{SpacingKind, UploadOptions};
use crate::lineage::{ModelName, RegimeName};
use local::Database;
use remote::Server;
use report::{Outcome, Report};

/// What `headway import` can be told.
#[derive(Debug, Args)]
pub(super) struct ImportArguments {
    /// Files of events, or recordings of whole roads: .json, .ndjson, .jsonl, .csv, .parquet, .npy (FollowNet) or .xml (SUMO
    /// FCD), each also with .gz or .zst behind it
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Into which model
    #[arg(long, value_name = "NAME", default_value = "default", value_parser = ModelName::parse)]
    model: ModelName,
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    place: Place,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
}

/// As in the query of an upload.
#[derive(Debug, Args)]
struct Options {
    /// How columns are named: headway, follownet, ngsim, fcd
    #[arg(long, value_name = "NAME", default_value = "headway", value_parser = word::<Preset>)]
    preset: Preset,
    /// Step of events that do not state one, s
    #[arg(long, value_name = "S")]
    dt_s: Option<f64>,
    /// What spacing is measured between: net, front, centre
    #[arg(long, value_name = "KIND", default_value = "net", value_parser = word::<SpacingKind>)]
    spacing: SpacingKind,
    /// Leader's length, m, where spacing is not net
    #[arg(long, value_name = "M")]
    leader_length_m: Option<f64>,
    /// Follower's length, m, where spacing is from centre to centre
    #[arg(long, value_name = "M")]
    follower_length_m: Option<f64>,
    /// Source of events that name none
    #[arg(long, value_name = "TEXT")]
    source: Option<String>,
    /// Label of the traffic
    #[arg(long, value_name = "NAME", value_parser = RegimeName::parse)]
    regime: Option<RegimeName>,
    /// Of a whole road: shortest event, s
    #[arg(long, value_name = "S")]
    min_duration_s: Option<f64>,
    /// Of a whole road: longest event, s
    #[arg(long, value_name = "S")]
    max_duration_s: Option<f64>,
    /// Of a whole road: least net spacing, m
    #[arg(long, value_name = "M")]
    min_spacing_m: Option<f64>,
    /// Of a whole road: largest net spacing, m
    #[arg(long, value_name = "M")]
    max_spacing_m: Option<f64>,
}

/// A word that a query knows too.
fn word<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(Value::from(text)).map_err(|error| error.to_string())
}

impl Options {
    fn of_upload(&self) -> UploadOptions {
        UploadOptions {
            preset: self.preset,
            dt_s: self.dt_s,
            spacing: self.spacing,
            leader_length_m: self.leader_length_m,
            follower_length_m: self.follower_length_m,
            source: self.source.clone(),
            regime: self.regime.clone(),
            min_duration_s: self.min_duration_s,
            max_duration_s: self.max_duration_s,
            min_spacing_m: self.min_spacing_m,
            max_spacing_m: self.max_spacing_m,
        }
    }
}

/// A file that is to be uploaded, and what its name says that it is.
struct Upload<'a> {
    path: &'a Path,
    file: File,
    bytes: u64,
    format: Format,
    encoding: Encoding,
    options: UploadOptions,
}

impl<'a> Upload<'a> {
    fn open(path: &'a Path, options: UploadOptions) -> anyhow::Result<Self> {
        let (format, encoding) = Format::of_file(path).context(
            "its name ends in none of .json, .ndjson, .jsonl, .csv, .parquet, .npy and .xml, with .gz or .zst or without",
        )?;
        let file = File::open(path)?;
        let about = file.metadata()?;
        if !about.is_file() {
            bail!("it is no file");
        }
        Ok(Self { path, file, bytes: about.len(), format, encoding, options })
    }
}

/// Where events go.
enum Target {
    Database(Box<Database>),
    Server(Box<Server>),
}

impl Target {
    async fn take(&self, upload: Upload<'_>, bar: &Bar) -> anyhow::Result<Outcome> {
        match self {
            Self::Database(database) => database.take(upload, bar).await,
            Self::Server(server) => server.take(upload, bar).await,
        }
    }
}

/// Imports every file, and fails unless all were taken.
pub(super) fn run(arguments: &ImportArguments) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let mut outcomes = Vec::new();
    let ended = runtime.block_on(import(arguments, &mut outcomes));
    // What was taken before something failed stays taken, and is told.
    if ended.is_ok() || !outcomes.is_empty() {
        Report { model: &arguments.model, outcomes: &outcomes }.print(arguments.json)?;
    }
    ended?;
    match outcomes.iter().filter(|(_, outcome)| outcome.is_refusal()).count() {
        0 => Ok(()),
        refused => bail!("{refused} of {} files were refused", outcomes.len()),
    }
}

/// Imports one file after the other, and ends when something fails that is not the file's.
async fn import(arguments: &ImportArguments, outcomes: &mut Vec<(PathBuf, Outcome)>) -> anyhow::Result<()> {
    let ImportArguments { files, model, options, place, .. } = arguments;
    let target = match place.server()? {
        Some(remote) => Target::Server(Box::new(Server::new(remote, model))),
        None => Target::Database(Box::new(Database::open(place.database(), model).await?)),
    };
    let (bar, mut ended) = (Bar::new(), Ok(()));
    for path in files {
        let outcome = match Upload::open(path, options.of_upload()) {
            Ok(upload) => target.take(upload, &bar).await,
            Err(error) => Ok(Outcome::Refused(json!({"code": "unreadable_file", "detail": format!("{error:#}")}))),
        };
        match outcome {
            Ok(outcome) => outcomes.push((path.clone(), outcome)),
            Err(error) => {
                ended = Err(error.context(format!("neither {} nor a file after it was imported", path.display())));
                break;
            }
        }
    }
    bar.end();
    if let Target::Database(database) = target {
        database.close().await;
    }
    ended
}
