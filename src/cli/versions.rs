//! `headway versions`: what a model has learned, version by version.

use clap::Args;
use serde_json::{Value, json};

use super::asked::Asked;
use super::measures::measures;
use super::member::{number, text, time};
use super::service::{Opened, Service};
use super::table::table;

/// What `headway versions` can be told.
#[derive(Debug, Args)]
pub(super) struct VersionsArguments {
    /// How this version drives, on the test events of every regime [default: a list of all]
    #[arg(value_name = "VERSION")]
    version: Option<u64>,
    #[command(flatten)]
    asked: Asked,
}

/// Lists versions, or tells of one.
pub(super) fn run(arguments: &VersionsArguments) -> anyhow::Result<()> {
    let VersionsArguments { version, asked } = arguments;
    asked.place.ask(Opened::Known, async |service| match version {
        None => list(asked, service).await,
        Some(version) => one(asked, service, *version).await,
    })
}

async fn list(asked: &Asked, service: &Service) -> anyhow::Result<()> {
    let model: Value = service.get(&asked.path("")).await?;
    let versions = service.list(&asked.path("/versions"), "versions").await?;
    asked.print(&json!({"versions": versions}), || {
        if versions.is_empty() {
            return format!(
                "{} has learned nothing yet: `headway import` brings events, `headway train` learns",
                asked.model
            );
        }
        let rows = versions.iter().map(|version| {
            let [number_of, stage, regime, parent] =
                ["version", "stage", "regime", "parent"].map(|name| text(&version[name]));
            let strength = number(&version["strength"], 2);
            vec![
                number_of,
                stage,
                regime,
                parent,
                text(&version["method"]),
                strength,
                states(version, &model),
                time(&version["created_at"]),
                text(&version["note"]),
            ]
        });
        table(
            &["VERSION", "STAGE", "REGIME", "PARENT", "METHOD", "STRENGTH", "STATE", "CREATED", "NOTE"],
            rows.collect(),
        )
    })
}

/// What there is to know of a version, by words.
fn states(version: &Value, model: &Value) -> String {
    let mut states = Vec::new();
    for role in ["live", "head"] {
        if version["version"] == model[role] {
            states.push(role);
        }
    }
    for state in ["tainted", "pruned"] {
        if version[state] == true {
            states.push(state);
        }
    }
    if !version["corrupt"].is_null() {
        states.push("corrupt");
    }
    states.join(",")
}

async fn one(asked: &Asked, service: &Service, version: u64) -> anyhow::Result<()> {
    let made: Value = service.get(&asked.path(&format!("/versions/{version}"))).await?;
    let evaluation: Value = service.get(&asked.path(&format!("/versions/{version}/evaluation"))).await?;
    asked.print(&json!({"version": made, "evaluation": evaluation}), || {
        let [regime, sha256, events] = ["regime", "weights_sha256", "events"].map(|name| text(&made[name]));
        let table = measures(&[(format!("v{version}"), &evaluation["tasks"])]);
        format!("version {version} of {}: {regime} traffic, {events} events, weights {sha256}\n\n{table}", asked.model)
    })
}
