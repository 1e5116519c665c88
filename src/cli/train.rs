//! `headway train`: what waits is learned now, and the version that came of it is told.

use anyhow::bail;
use clap::Args;
use serde_json::{Map, Value, json};

use super::advance::Progress;
use super::asked::Asked;
use super::measures::measures;
use super::member::text;
use super::serve::signals;
use super::service::{Opened, Refusal, Service, Task};
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
    /// Do not wait for the tasks; at a server only
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
    arguments.asked.place.ask(Opened::Learning, async |service| {
        let interrupted = signals()?;
        tokio::select! {
            trained = train(arguments, service) => trained,
            () = interrupted => bail!("interrupted; {}", service.goes_on()),
        }
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
    let mut ids = waiting(service, &tasks).await?;
    match service.post::<Value>(&tasks, &wish).await {
        Ok(queued) if *detach => return asked.print(&queued, || format!("queued: {}", text(&queued["task_ids"]))),
        Ok(queued) => ids.extend(queued["task_ids"].as_array().into_iter().flatten().map(text)),
        // What waited before may be all there is.
        Err(error) if !ids.is_empty() && batches.is_empty() && is_nothing_pending(&error) => {}
        Err(error) => return Err(error),
    }
    let mut trained = Vec::new();
    for id in ids {
        trained.push(follow(asked, service, &format!("{tasks}/{id}")).await?);
    }
    asked.print(&json!({"trained": trained}), || {
        trained.iter().map(|of| told(asked, of)).collect::<Vec<_>>().join("\n\n")
    })
}

/// Tasks that were asked for before and have not ended, the oldest first.
async fn waiting(service: &Service, tasks: &str) -> anyhow::Result<Vec<String>> {
    let known = service.list(tasks, "tasks").await?;
    let waits = |task: &&Value| ["queued", "running"].contains(&task["state"].as_str().unwrap_or_default());
    Ok(known.iter().filter(waits).map(|task| text(&task["task_id"])).collect())
}

fn is_nothing_pending(error: &anyhow::Error) -> bool {
    error.downcast_ref().is_some_and(|refusal: &Refusal| refusal.code == "nothing_pending")
}

/// What came of a task, once it has ended.
async fn follow(asked: &Asked, service: &Service, path: &str) -> anyhow::Result<Value> {
    let task: Task = service.get(path).await?;
    let mut progress = Progress::new(asked.model.as_str(), task.regime.as_deref().unwrap_or_default());
    let ended = service.follow(path, |advance| progress.show(advance)).await;
    progress.end();
    let Task { id, state, version, error, .. } = &ended?;
    let Some(version) = version.filter(|_| state == "succeeded") else {
        let why = error.as_ref().map_or_else(String::new, |error| format!(": {}: {}", error.code, error.detail));
        bail!("task {id} has {state}{why}");
    };
    let made: Value = service.get(&asked.path(&format!("/versions/{version}"))).await?;
    let evaluation: Value = service.get(&asked.path(&format!("/versions/{version}/evaluation"))).await?;
    Ok(json!({"task_id": id, "version": made, "evaluation": evaluation}))
}

fn told(asked: &Asked, trained: &Value) -> String {
    let (made, evaluation) = (&trained["version"], &trained["evaluation"]);
    let [version, regime] = ["version", "regime"].map(|member| text(&made[member]));
    let [decision, reason] = ["decision", "reason"].map(|member| text(&made["promotion"][member]));
    let table = measures(&[(format!("v{version}"), &evaluation["tasks"])]);
    format!("version {version} of {} has learned {regime} traffic; {decision}: {reason}\n\n{table}", asked.model)
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
