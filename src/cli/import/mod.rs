//! `headway import`: event files into a model, as an upload takes them, in a database that nobody serves or at a server.

/// What came of it, for people and for programs.
mod report;

use std::io;
use std::path::PathBuf;

use anyhow::bail;
use bytes::Bytes;
use clap::Args;
use futures_util::Stream;
use hyper::body::Frame;
use serde_json::{Map, Value, json};

use super::asked::Asked;
use super::event_file::{EventFile, EventOptions};
use super::looking::Bar;
use super::service::{FileBody, Opened, Service};
use report::{Outcome, Report};

/// What `headway import` can be told.
#[derive(Debug, Args)]
pub(super) struct ImportArguments {
    /// Files of events, or recordings of whole roads: .json, .ndjson, .jsonl, .csv, .parquet, .npy (FollowNet) or .xml (SUMO
    /// FCD), each also with .gz or .zst behind it
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    options: EventOptions,
    #[command(flatten)]
    asked: Asked,
}

/// Imports every file, and fails unless all were taken.
pub(super) fn run(arguments: &ImportArguments) -> anyhow::Result<()> {
    let (asked, mut outcomes) = (&arguments.asked, Vec::new());
    let ended = asked.place.ask(Opened::Made, async |service| import(arguments, service, &mut outcomes).await);
    // What was taken before something failed stays taken, and is told.
    if ended.is_ok() || !outcomes.is_empty() {
        Report { model: &asked.model, outcomes: &outcomes }.print(asked.json)?;
    }
    ended?;
    match outcomes.iter().filter(|(_, outcome)| outcome.is_refusal()).count() {
        0 => Ok(()),
        refused => bail!("{refused} of {} files were refused", outcomes.len()),
    }
}

/// Imports one file after the other, and ends when something fails that is not the file's.
async fn import(
    arguments: &ImportArguments,
    service: &Service,
    outcomes: &mut Vec<(PathBuf, Outcome)>,
) -> anyhow::Result<()> {
    let ImportArguments { files, options, asked } = arguments;
    let to = asked.path(&format!("/batches{}", options.query()));
    let (bar, mut ended) = (Bar::new(), Ok(()));
    for path in files {
        let outcome = match EventFile::open(path) {
            Ok(file) => take(service, &to, file.into_body(&bar)).await,
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
    ended
}

/// Uploads a file.
async fn take<S>(service: &Service, to: &str, body: FileBody<S>) -> anyhow::Result<Outcome>
where
    S: Stream<Item = io::Result<Frame<Bytes>>> + Send + 'static,
{
    let (taken, answer) = service.upload(to, body).await?;
    Ok(match answer {
        Value::Object(mut members) if members.contains_key("batch_id") => {
            // Those of a problem say what the receipt says.
            for member in ["type", "title", "status", "detail", "instance", "code", "request_id"] {
                members.remove(member);
            }
            Outcome::of_receipt(members, !taken)
        }
        answer => Outcome::Refused(told(answer)),
    })
}

/// What is told of a problem.
fn told(problem: Value) -> Value {
    let Value::Object(mut problem) = problem else { return problem };
    let kept = ["code", "detail", "errors", "request_id"].map(|member| (member, problem.remove(member)));
    Value::Object(
        kept.into_iter().filter_map(|(member, value)| Some((member.to_owned(), value?))).collect::<Map<_, _>>(),
    )
}
