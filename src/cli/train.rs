//! `headway train`: what waits is learned now, and the version that came of it is told.

use anyhow::bail;
use clap::Args;
use serde_json::{Map, Value, json};

use super::advance::Progress;
use super::asked::{Asked, block_on};
use super::measures::measures;
use super::service::{Opened, Service, Task};
use crate::lineage::RegimeName;

/// What `headway train` can be told.
#[derive(Debug, Args)]
pub(super) struct TrainArguments {
    /// Batches to learn from, separated by commas [default: what is pending]
    #[arg(long, value_name = "BATCHES", value_delimiter = ',')]
    batches: Vec<String>,
    /// Learn what is labelled so, or give what is learned this label
    #[arg(long, value_name = "NAME", value_parser = RegimeName::parse)]
    regime: Option<RegimeName>,
    /// A setting of this task alone, as often as needed: --set strength=auto
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = setting)]
    settings: Vec<(String, Value)>,
    /// Do not wait for the task; at a server only
    #[arg(long, requires = "server")]
    detach: bool,
    #[command(flatten)]
    asked: Asked,
}

/// A value is JSON, or else text.
pub(super) fn setting(text: &str) -> Result<(String, Value), String> {
    let (key, value) = text.split_once('=').ok_or("KEY=VALUE is needed")?;
    Ok((key.to_owned(), serde_json::from_str(value).unwrap_or_else(|_| Value::from(value))))
}

/// Learns, and fails unless a version came of it.
pub(super) fn run(arguments: &TrainArguments) -> anyhow::Result<()> {
    block_on(async {
        let service = arguments.asked.place.service(Opened::Learning).await?;
        let trained = train(arguments, &service).await;
        service.close().await;
        trained
    })
}

async fn train(arguments: &TrainArguments, service: &Service) -> anyhow::Result<()> {
    let TrainArguments { batches, regime, settings, detach, asked } = arguments;
    let mut wish = json!({"batches": if batches.is_empty() { json!("pending") } else { json!(batches) }});
    if let Some(regime) = regime {
        wish["regime"] = json!(regime);
    }
    if !settings.is_empty() {
        wish["settings"] = Value::Object(settings.iter().cloned().collect::<Map<_, _>>());
    }
    let tasks = asked.path("/tasks");
    let made: Value = service.post(&tasks, &wish).await?;
    let id = made["task_id"].as_str().unwrap_or_default();
    if *detach {
        return asked.print(&made, || format!("task {id} is queued"));
    }
    let mut progress = Progress::new(asked.model.as_str(), made["regime"].as_str().unwrap_or_default());
    let ended = service.follow(&format!("{tasks}/{id}"), |advance| progress.show(advance)).await;
    progress.end();
    let Task { id, state, version, error, regime, .. } = &ended?;
    let Some(version) = version.filter(|_| state == "succeeded") else {
        let why = error.as_ref().map_or_else(String::new, |error| format!(": {}: {}", error.code, error.detail));
        bail!("task {id} has {state}{why}");
    };
    let made: Value = service.get(&asked.path(&format!("/versions/{version}"))).await?;
    let evaluation: Value = service.get(&asked.path(&format!("/versions/{version}/evaluation"))).await?;
    let promotion = &made["promotion"];
    asked.print(&json!({"version": made, "evaluation": evaluation}), || {
        let [decision, reason] = ["decision", "reason"].map(|member| promotion[member].as_str().unwrap_or_default());
        let of = format!("version {version} of {}", asked.model);
        let regime = regime.as_deref().unwrap_or_default();
        let table = measures(&[(format!("v{version}"), &evaluation["tasks"])]);
        format!("{of} has learned {regime} traffic; {decision}: {reason}\n\n{table}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_is_json_or_text() {
        assert_eq!(setting("epochs=3"), Ok(("epochs".to_owned(), json!(3))));
        assert_eq!(setting("strength=auto"), Ok(("strength".to_owned(), json!("auto"))));
        assert_eq!(setting("strength=null"), Ok(("strength".to_owned(), Value::Null)));
        assert!(setting("strength").is_err());
    }
}
