//! `headway evaluate`: how versions and drivers out of the literature do on events that are not kept.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use serde_json::Value;

use super::asked::Asked;
use super::event_file::{EventFile, EventOptions};
use super::looking::Bar;
use super::measures::measures;
use super::member::text;
use super::service::{Opened, Service};

/// What `headway evaluate` can be told.
#[derive(Debug, Args)]
pub(super) struct EvaluateArguments {
    /// A file of events, as `headway import` takes them
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Versions, separated by commas [default: the one that serves]
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    versions: Vec<u64>,
    /// Drivers to compare with, separated by commas: idm, gipps, constant
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    references: Vec<String>,
    #[command(flatten)]
    options: EventOptions,
    #[command(flatten)]
    asked: Asked,
}

/// Evaluates, and prints a row for each driver and regime.
pub(super) fn run(arguments: &EvaluateArguments) -> anyhow::Result<()> {
    let EvaluateArguments { file, asked, .. } = arguments;
    let opened = EventFile::open(file).with_context(|| format!("cannot read {}", file.display()))?;
    let bar = Bar::new();
    let answer = asked.place.ask(Opened::Known, async |service| ask(arguments, service, opened, &bar).await);
    bar.end();
    let answer = answer?;
    asked.print(&answer, || {
        let members = |name: &str| answer[name].as_array().map_or(&[][..], Vec::as_slice);
        let versions = members("versions").iter().map(|each| (format!("v{}", each["version"]), &each["tasks"]));
        let references = members("references").iter().map(|each| (text(&each["reference"]), &each["tasks"]));
        let table = measures(&versions.chain(references).collect::<Vec<_>>());
        let rejected = match answer["rejected_count"].as_u64() {
            None | Some(0) => String::new(),
            Some(rejected) => format!("\n\n{rejected} events were rejected; --json lists them"),
        };
        format!("{table}{rejected}")
    })
}

async fn ask(arguments: &EvaluateArguments, service: &Service, file: EventFile, bar: &Bar) -> anyhow::Result<Value> {
    let EvaluateArguments { versions, references, options, asked, .. } = arguments;
    let versions = versions.iter().map(u64::to_string).collect::<Vec<_>>().join(",");
    let query = options.query_with(&[("versions", versions), ("references", references.join(","))]);
    let path = asked.path(&format!("/evaluate{query}"));
    match service.upload(&path, file.into_body(bar)).await? {
        (true, answer) => Ok(answer),
        (false, refused) => bail!("{}: {}", text(&refused["title"]), text(&refused["detail"])),
    }
}
