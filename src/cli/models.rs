//! `headway models`: which there are, and new ones.

use clap::{Args, Subcommand};
use serde_json::{Map, Value, json};

use super::asked::{Somewhere, print};
use super::member::{text, time};
use super::service::Opened;
use super::table::table;
use super::train::setting;
use crate::lineage::ModelName;

/// What `headway models` can be told.
#[derive(Debug, Args)]
pub(super) struct ModelsArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Every model, what serves and what is learned on from.
    List(Somewhere),
    /// A new model that has learned nothing.
    Create(CreateArguments),
}

#[derive(Debug, Args)]
struct CreateArguments {
    /// Its name
    #[arg(value_name = "NAME", value_parser = ModelName::parse)]
    name: ModelName,
    /// How it keeps from forgetting: ewc, mas, si, replay, `replay_ewc`, `replay_mas`, joint, naive
    #[arg(long, value_name = "METHOD", default_value = "ewc")]
    method: String,
    /// A setting other than the server's default, as often as needed: --set hidden=64
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = setting)]
    settings: Vec<(String, Value)>,
    #[command(flatten)]
    of: Somewhere,
}

/// Lists models, or makes one.
pub(super) fn run(arguments: &ModelsArguments) -> anyhow::Result<()> {
    match &arguments.command {
        Command::List(of) => list(of),
        Command::Create(arguments) => create(arguments),
    }
}

fn list(of: &Somewhere) -> anyhow::Result<()> {
    let models = of.place.ask(Opened::Known, async |service| service.list("/v1/models", "models").await)?;
    print(of.json, &json!({"models": models}), || {
        let rows = models.iter().map(|model| {
            let state = if model["paused"] == true { "paused".to_owned() } else { String::new() };
            let [name, method, live, head] = ["model", "method", "live", "head"].map(|member| text(&model[member]));
            vec![name, method, live, head, state, time(&model["created_at"])]
        });
        table(&["MODEL", "METHOD", "LIVE", "HEAD", "STATE", "CREATED"], rows.collect())
    })
}

fn create(arguments: &CreateArguments) -> anyhow::Result<()> {
    let CreateArguments { name, method, settings, of } = arguments;
    let settings = Value::Object(settings.iter().cloned().collect::<Map<_, _>>());
    let wish = json!({"model": name, "method": method, "settings": settings});
    let made: Value = of.place.ask(Opened::Made, async |service| service.post("/v1/models", &wish).await)?;
    print(of.json, &made, || format!("the model {name} is there, and has learned nothing yet"))
}
