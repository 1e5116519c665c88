//! `headway demo`: the whole main job on a real server, over the API that everybody has.

/// What the API answers, as far as the demo reads it.
mod answers;
/// Lines to paste into a shell.
mod curl;
/// Events from files.
mod recorded;
/// What came out, as one JSON object.
mod report;
/// The server, on a database of its own.
mod server;
/// From uploads to a rollback.
mod story;
/// Tables for a terminal.
mod tables;
/// Recorded events into three tasks by speed.
mod thirds;
/// Where the events come from.
mod traffic;
/// What the numbers mean, in sentences.
mod verdict;

use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::pin::pin;
use std::time::Instant;

use anyhow::{Context, anyhow};
use clap::{Args, value_parser};

use crate::telemetry::{LogFormat, LogSettings, start_logging};
use report::Report;
use server::DemoServer;
use story::Story;
use traffic::{EVENTS_RANGE, Traffic};

/// Enough for a hundred updates a stage: with fewer, what a stage learns has not settled, and there is less to protect.
const GENERATED_EVENTS: u32 = 900;
/// Recorded events are about half as long again.
const RECORDED_EVENTS: u32 = 600;

/// What `headway demo` can be told.
#[derive(Debug, Args)]
pub(super) struct DemoArguments {
    /// Recorded events instead of generated ones: .parquet, .csv, .json or .ndjson, as an upload takes them.
    /// They are split into three tasks by mean follower speed
    #[arg(long, value_name = "FILE", num_args = 1..)]
    events: Vec<PathBuf>,
    /// Events of each kind of traffic: so many are generated [default: 900], and no more of recorded ones, which are
    /// longer, are used [default: 600]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(EVENTS_RANGE))]
    events_per_regime: Option<u32>,
    /// Seed of the generated traffic and of the training
    #[arg(long, value_name = "N", default_value_t = 42)]
    seed: u64,
    /// Hidden units of both networks [default: the server's, 128]
    #[arg(long, value_name = "N")]
    hidden: Option<u32>,
    /// Passes over the events of each task [default: the server's, 5]
    #[arg(long, value_name = "N")]
    epochs: Option<u32>,
    /// Address and port of the server; port 0 picks a free one [default: 127.0.0.1:8080, or a free port when it is taken]
    #[arg(long, value_name = "HOST:PORT")]
    listen: Option<SocketAddr>,
    /// Keep the database in this new file [default: in a temporary folder that goes when the demo ends]
    #[arg(long, value_name = "FILE")]
    database: Option<PathBuf>,
    /// End the server and the demo once the work is done
    #[arg(long)]
    exit: bool,
    /// Print what came out as one JSON object, and nothing else, on stdout
    #[arg(long)]
    json: bool,
}

/// Tells the story; then serves until SIGTERM or SIGINT, unless told to end.
pub(super) fn run(arguments: &DemoArguments) -> anyhow::Result<()> {
    start_logging(&LogSettings { format: LogFormat::Text, filter: "warn".to_owned() })?;
    let traffic = if arguments.events.is_empty() {
        Traffic::generated(arguments.seed, arguments.events_per_regime.unwrap_or(GENERATED_EVENTS))
    } else {
        recorded::traffic(&arguments.events, arguments.events_per_regime.unwrap_or(RECORDED_EVENTS))?
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let done = runtime.block_on(perform(arguments, &traffic));
    runtime.shutdown_background();
    done
}

async fn perform(arguments: &DemoArguments, traffic: &Traffic) -> anyhow::Result<()> {
    let mut signal = pin!(super::serve::signals()?);
    let mut server = DemoServer::start(arguments).await?;
    let done = tokio::select! {
        told = tell(arguments, traffic, &server) => told,
        () = &mut signal => Err(anyhow!("interrupted before the work was done")),
    };
    if done.is_ok() && !arguments.exit {
        tokio::select! {
            () = signal => {}
            ended = server.ended() => return ended,
        }
    }
    let stopped = server.stop().await;
    done.and(stopped)
}

async fn tell(arguments: &DemoArguments, traffic: &Traffic, server: &DemoServer) -> anyhow::Result<()> {
    let begun = Instant::now();
    let mut story = Story::new(arguments, traffic, server)?;
    story.open()?;
    story.create_models().await?;
    for regime in &traffic.regimes {
        story.learn(regime).await?;
    }
    story.compare()?;
    let rolled_back = story.roll_back().await?;
    let curl = curl::lines(server.url());
    story.close(&curl, begun.elapsed())?;
    if arguments.json {
        let report = Report::new(&story, rolled_back, &curl, begun.elapsed());
        let mut stdout = std::io::stdout().lock();
        serde_json::to_writer(&mut stdout, &report).context("cannot write the result")?;
        writeln!(stdout)?;
        stdout.flush()?;
    }
    Ok(())
}
