//! `headway archive`: a model in a file of its own, and out of one.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use bytes::Bytes;
use clap::Args;
use futures_util::stream;
use hyper::body::Frame;
use serde_json::{Value, json};
use tokio::io::AsyncReadExt;

use super::looking::Bar;
use super::service::{FileBody, ServerArguments, Service};
use super::settings;
use super::waiting::block_on;
use crate::lineage::ModelName;
use crate::store::copy::{self, Archive};
use crate::store::{Actor, Store, backup};

/// Bytes sent at once.
const PIECE_BYTES: usize = 256 << 10;

/// What `headway archive` can be told.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("way").required(true).args(["to", "from"]))]
pub(super) struct ArchiveArguments {
    /// The model; with --from its name from then on, which must be free
    #[arg(long, value_name = "NAME", value_parser = ModelName::parse)]
    model: ModelName,
    /// Put the model into this new file
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
    /// Take the model that this archive holds in
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// The database file; a server may own it while a model is put into a file, and not while one is taken in
    #[arg(long, value_name = "FILE", required_unless_present = "server")]
    database: Option<PathBuf>,
    /// Take the place of a file that is there
    #[arg(long, requires = "to")]
    force: bool,
    #[command(flatten)]
    server: ServerArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Moves a model into a file or out of it.
#[expect(clippy::print_stdout, reason = "the result")]
pub(super) fn run(arguments: &ArchiveArguments) -> anyhow::Result<()> {
    let bar = Bar::new();
    let done = block_on(moved(arguments, &bar));
    bar.end();
    let done = done?;
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&done)?);
    } else if let Some(to) = &arguments.to {
        println!("{} holds the model {}, {} bytes, verified", to.display(), arguments.model, done["bytes"]);
    } else {
        println!("the model {} is there, live version {}, head {}", arguments.model, done["live"], done["head"]);
    }
    Ok(())
}

async fn moved(arguments: &ArchiveArguments, bar: &Bar) -> anyhow::Result<Value> {
    let name = &arguments.model;
    match (arguments.server.service()?, &arguments.database, &arguments.to, &arguments.from) {
        (Some(server), _, Some(to), _) => download(&server, name, to, arguments.force).await,
        (Some(server), _, _, Some(from)) => upload(&server, name, from).await,
        (None, Some(database), Some(to), _) => {
            let written = copy::archive(database, name, to, arguments.force, &|looking| bar.show(looking)).await?;
            if written.is_none() {
                bail!("{} has no model {name}", database.display());
            }
            Ok(json!({"name": to, "bytes": std::fs::metadata(to)?.len()}))
        }
        (None, Some(database), _, Some(from)) => take_in(database, name, from, bar).await,
        _ => bail!("--database FILE or --server URL, and --to FILE or --from FILE"),
    }
}

async fn download(server: &Service, name: &ModelName, to: &Path, force: bool) -> anyhow::Result<Value> {
    let draft = backup::draft(to)?;
    let mut file = File::create(&draft)?;
    server.download(&format!("/v1/models/{name}/archive"), &mut file).await?;
    backup::publish(draft, to, force)?;
    Ok(json!({"name": to, "bytes": file.metadata()?.len()}))
}

async fn upload(server: &Service, name: &ModelName, from: &Path) -> anyhow::Result<Value> {
    let file = tokio::fs::File::open(from).await.with_context(|| format!("cannot read {}", from.display()))?;
    let chunks = stream::try_unfold(file, |mut file| async move {
        let mut piece = Vec::with_capacity(PIECE_BYTES);
        (&mut file).take(PIECE_BYTES as u64).read_to_end(&mut piece).await?;
        Ok((!piece.is_empty()).then(|| (Frame::data(Bytes::from(piece)), file)))
    });
    let body = FileBody { content_type: copy::MEDIA_TYPE, content_encoding: None, chunks };
    match server.upload(&format!("/v1/models/{name}/archive"), body).await? {
        (true, model) => Ok(model),
        (false, refused) => bail!("{}", refused["detail"].as_str().unwrap_or("the server did not take it")),
    }
}

async fn take_in(database: &Path, name: &ModelName, from: &Path, bar: &Bar) -> anyhow::Result<Value> {
    let config = settings::of_a_server(Some(database))?;
    let mut file = File::open(from).with_context(|| format!("cannot read {}", from.display()))?;
    let archive = Archive::received(&mut file, &config.ingest.spool_folder)?;
    if let Err(why) = archive.examine(&|looking| bar.show(looking)).await? {
        bail!("{} is no archive that can be taken in: {why}", from.display());
    }
    let store = Store::open(&config.database).await?;
    let mut transaction = store.begin_for(&Actor::local()).await?;
    let Some(model) = archive.take_in(&mut transaction, name).await? else {
        bail!("a model is already called {name}");
    };
    transaction.commit().await?;
    store.let_go().await?;
    store.close().await;
    Ok(json!({"model": model.name, "method": model.method, "live": model.live, "head": model.head}))
}
