//! From uploads to a rollback: every number that is told was answered by the API.

use std::collections::BTreeMap;
use std::io::Write;
use std::time::Duration;

use anyhow::{Context, bail};
use bytes::Bytes;
use futures_util::stream;
use hyper::body::Frame;
use serde::Serialize;
use serde_json::{Map, json};

use super::DemoArguments;
use super::answers::{Evaluation, Model, Moved, Predicted, Receipt};
use super::curl::window;
use super::server::DemoServer;
use super::tables::{self, Learned, Measure};
use super::traffic::{RegimeTraffic, Traffic};
use super::verdict;
use crate::cli::advance::Progress;
use crate::cli::service::{FileBody, Service, Task};

/// The twins, which are called as their methods are.
pub(super) const MODELS: [&str; 2] = ["ewc", "naive"];

/// What a model made of one task.
#[derive(Serialize)]
pub(super) struct Stage {
    #[serde(rename = "stage")]
    pub(super) number: u32,
    pub(super) regime: &'static str,
    pub(super) version: i64,
    pub(super) task_id: String,
    pub(super) seconds: Option<f64>,
    pub(super) evaluation: Evaluation,
    #[serde(skip)]
    pub(super) upload: Receipt,
}

/// What served before the rollback and after it.
#[derive(Serialize)]
pub(super) struct RolledBack {
    predicted_before: Predicted,
    rollback: Moved,
    predicted_after: Predicted,
}

/// What is told, and what was answered so far.
pub(super) struct Story<'a> {
    pub(super) arguments: &'a DemoArguments,
    pub(super) traffic: &'a Traffic,
    pub(super) server: &'a DemoServer,
    service: Service,
    stages: BTreeMap<&'static str, Vec<Stage>>,
}

impl<'a> Story<'a> {
    pub(super) fn new(
        arguments: &'a DemoArguments,
        traffic: &'a Traffic,
        server: &'a DemoServer,
    ) -> anyhow::Result<Self> {
        let stages = MODELS.map(|model| (model, Vec::new())).into();
        Ok(Self { arguments, traffic, server, service: Service::at(server.url())?, stages })
    }

    /// Names of the regimes, in the order learned.
    pub(super) fn regimes(&self) -> Vec<&'static str> {
        self.traffic.regimes.iter().map(|of| of.regime.as_str()).collect()
    }

    /// What a model has learned.
    pub(super) fn stages(&self, model: &str) -> &[Stage] {
        &self.stages[model]
    }

    /// Of each regime but the last: the last version's error over that of the version that had just learned it.
    pub(super) fn forgetting(&self, model: &str) -> Vec<Option<f64>> {
        let last = &self.stages[model].last().expect("every task was learned").evaluation;
        let regimes = self.regimes();
        let of = |regime: &&str| last.tasks.iter().find(|task| task.regime == **regime)?.forgetting_ratio;
        regimes[..regimes.len() - 1].iter().map(of).collect()
    }

    /// Who and what there is.
    pub(super) fn open(&self) -> anyhow::Result<()> {
        self.say(&format!("Headway {}: learning to follow without forgetting\n", env!("CARGO_PKG_VERSION")))?;
        self.say(&format!("Server   {}", self.server.place()))?;
        self.say(&format!("Traffic  {}", self.traffic.origin))
    }

    /// Two models that differ in their method alone.
    pub(super) async fn create_models(&self) -> anyhow::Result<()> {
        // The paper's settings forget more, and this is to show what forgetting is.
        let mut settings = Map::from_iter([
            ("preset".to_owned(), json!("paper")),
            ("schedule".to_owned(), json!("manual")),
            ("promotion".to_owned(), json!("auto")),
            ("seed".to_owned(), json!(self.arguments.seed)),
        ]);
        for (name, value) in [("hidden", self.arguments.hidden), ("epochs", self.arguments.epochs)] {
            if let Some(value) = value {
                settings.insert(name.to_owned(), json!(value));
            }
        }
        let mut used = None;
        for model in MODELS {
            let wish = json!({"model": model, "method": model, "settings": settings});
            used = Some(self.service.post::<Model>("/v1/models", &wish).await?.settings);
        }
        let used = used.expect("two models were made");
        self.say(&format!(
            "Models   ewc holds on to what matters to earlier traffic, naive is its twin that does not; \
             {} hidden units, {} epochs",
            used.hidden, used.epochs
        ))
    }

    /// Both models get the events of one regime and learn them.
    pub(super) async fn learn(&mut self, traffic: &RegimeTraffic) -> anyhow::Result<()> {
        let regime = traffic.regime.as_str();
        let stage = self.stages(MODELS[0]).len() + 1;
        self.say(&format!("\nStage {stage}: {regime} traffic"))?;
        let mut uploads = Vec::new();
        for model in MODELS {
            let path = format!("/v1/models/{model}/batches?regime={regime}");
            let receipt: Receipt = self.upload(&path, &traffic.ndjson).await?;
            uploads.push((model, receipt));
        }
        self.say(&format!("  {}", upload_told(&uploads[0].1, traffic.left_out)))?;
        for (model, upload) in uploads {
            let learned = self.learn_with(model, regime, upload).await?;
            self.stages.entry(model).or_default().push(learned);
        }
        Ok(())
    }

    /// Uploads events, one a line.
    async fn upload(&self, path: &str, ndjson: &str) -> anyhow::Result<Receipt> {
        let chunk = Frame::data(Bytes::copy_from_slice(ndjson.as_bytes()));
        let chunks = stream::iter([Ok(chunk)]);
        let body = FileBody { content_type: "application/x-ndjson", content_encoding: None, chunks };
        match self.service.upload(path, body).await? {
            (true, receipt) => Ok(serde_json::from_value(receipt)?),
            (false, refused) => bail!("{path} answered {refused}"),
        }
    }

    async fn learn_with(&self, model: &str, regime: &'static str, upload: Receipt) -> anyhow::Result<Stage> {
        let tasks = format!("/v1/models/{model}/tasks");
        let task: Task = self.service.post(&tasks, &json!({"batches": "pending", "regime": regime})).await?;
        let mut progress = Progress::new(model, regime);
        let ended = self.service.follow(&format!("{tasks}/{}", task.id), |advance| progress.show(advance)).await;
        progress.end();
        let ended = ended?;
        if ended.state != "succeeded" {
            let why = ended.error.map_or_else(String::new, |error| format!(": {}: {}", error.code, error.detail));
            bail!("{model} did not learn {regime} traffic, its task {} has {}{why}", ended.id, ended.state);
        }
        let version = ended.version.context("a task that succeeded has a version")?;
        let evaluation = self.service.get(&format!("/v1/models/{model}/versions/{version}/evaluation")).await?;
        let served: Model = self.service.get(&format!("/v1/models/{model}")).await?;
        let live = if served.live == Some(version) { "now live" } else { "not live" };
        let seconds = ended.seconds();
        let took = seconds.map_or_else(String::new, |seconds| format!(" in {seconds:.1} s"));
        self.say(&format!("  {model:<5}  learned it{took}: version {version}, {live}"))?;
        let number = ended.stage.context("a task that succeeded has a stage")?;
        Ok(Stage { number, regime, version, task_id: ended.id, seconds, evaluation, upload })
    }

    /// The tables, what was forgotten, and what that means.
    pub(super) fn compare(&self) -> anyhow::Result<()> {
        let regimes = self.regimes();
        let learned = MODELS.map(|model| Learned {
            model,
            evaluations: self.stages(model).iter().map(|stage| &stage.evaluation).collect(),
        });
        self.say("\nHow each version drives on test events of the traffic seen so far\n")?;
        for measure in Measure::ALL {
            self.say(&tables::stages(&learned, &regimes, measure))?;
        }
        let earlier = &regimes[..regimes.len() - 1];
        let [ewc, naive] = MODELS.map(|model| self.forgetting(model));
        self.say(&tables::forgetting(&[("ewc", ewc.clone()), ("naive", naive.clone())], earlier))?;
        self.say(&verdict::forgetting(earlier, &ewc, &naive))?;
        let last = regimes.last().expect("three regimes");
        let [ewc, naive] = learned.map(|of| {
            let matrix = tables::matrix(&of.evaluations, &regimes, Measure::Spacing);
            matrix.last().and_then(|row| *row.last()?)
        });
        self.say(&verdict::price(last, ewc, naive))
    }

    /// Predicts, goes back a version, predicts again.
    pub(super) async fn roll_back(&self) -> anyhow::Result<RolledBack> {
        self.say("\nPredict, roll back, predict again")?;
        self.say("  At 18 m/s, 23.2 m behind a leader at 16 m/s:")?;
        let predicted_before = self.predict().await?;
        let reason = json!({"reason": "to show that an update can be taken back"});
        let rollback: Moved = self.service.post("/v1/models/ewc/rollback", &reason).await?;
        let Moved { from, live, head, .. } = &rollback;
        self.say(&format!(
            "  rolled back: version {live} serves instead of {from}, and learning would go on from version {head}"
        ))?;
        let predicted_after = self.predict().await?;
        Ok(RolledBack { predicted_before, rollback, predicted_after })
    }

    async fn predict(&self) -> anyhow::Result<Predicted> {
        let ask = json!({"windows": [window()]});
        let predicted: Predicted = self.service.post("/v1/models/ewc/predict", &ask).await?;
        let first = predicted.predictions.first().context("one window has one prediction")?;
        let flags = if first.flags.is_empty() { String::new() } else { format!(" ({})", first.flags.join(", ")) };
        let (version, accel_mps2) = (predicted.version, first.accel_mps2);
        self.say(&format!("  version {version} of ewc answers {accel_mps2:+.3} m/s²{flags}"))?;
        Ok(predicted)
    }

    /// How long it took, and what to try.
    pub(super) fn close(&self, curl: &[String; 3], took: Duration) -> anyhow::Result<()> {
        self.say(&format!("\nDone in {:.0} s.", took.as_secs_f64()))?;
        if self.arguments.exit {
            return Ok(());
        }
        self.say(&format!("The server goes on at {} until Ctrl-C. Try, in another terminal:\n", self.server.url()))?;
        self.say(&curl.join("\n\n"))
    }

    /// One more line for a reader; with --json nobody reads.
    fn say(&self, text: &str) -> anyhow::Result<()> {
        if self.arguments.json {
            return Ok(());
        }
        let mut stdout = std::io::stdout().lock();
        writeln!(stdout, "{text}")?;
        Ok(stdout.flush()?)
    }
}

/// What became of an upload.
fn upload_told(receipt: &Receipt, left_out: usize) -> String {
    let split = |name: &str| receipt.summary.splits.get(name).copied().unwrap_or_default();
    let speeds = receipt.summary.mean_speed_mps;
    let speeds = speeds
        .map_or_else(String::new, |speeds| format!(", mean speeds of {:.1} to {:.1} m/s", speeds.min, speeds.max));
    let (train, test) = (split("train"), split("test"));
    let told = format!("{} events uploaded to each{speeds}; {train} to train on, {test} to test on", receipt.accepted);
    let rest = [
        (receipt.rejected_count, "rejected"),
        (receipt.duplicates, "known already"),
        (left_out as u64, "left out to keep it short"),
    ];
    let rest = rest.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    std::iter::once(told).chain(rest).collect::<Vec<_>>().join("; ")
}
