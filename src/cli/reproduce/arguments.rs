//! What `headway reproduce` can be told, and what of it cannot be.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use clap::{Args, ValueEnum};
use serde_json::{Map, Value};

use crate::consolidation::Method;
use crate::lineage::ModelSettings;

/// Fewest steps of an event beyond the horizon: some to be driven.
const MIN_DRIVEN_STEPS: u32 = 10;

/// Arguments of `headway reproduce`.
#[derive(Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the command line")]
pub(in crate::cli) struct ReproduceArguments {
    /// Recorded events: .parquet, .csv, .json or .ndjson, as an upload takes them; columns are recognised by name
    #[arg(long, value_name = "FILE", num_args = 1.., required = true)]
    pub(super) events: Vec<PathBuf>,
    /// Methods to learn with, separated by commas: joint, naive, ewc, mas, si, replay, `replay_ewc`, `replay_mas`
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "joint,naive,ewc,mas")]
    pub(super) methods: Vec<String>,
    /// Folder for report.json, report.md, the figures, and what is needed to go on after an interruption
    #[arg(long, value_name = "DIR")]
    pub(super) out: PathBuf,
    /// Tasks and sides of the events from a CSV file with columns `event_id`, `task` and `split` (train, validation or test)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["tasks", "split"])]
    pub(super) splits: Option<PathBuf>,
    /// Tasks: so many of equally many events by mean follower speed, or `source` for one a source [default: 3]
    #[arg(long, value_name = "N|source")]
    pub(super) tasks: Option<String>,
    /// 70/15/15 into training, validation and test: inside each task at random, or by whole runs
    #[arg(long, value_enum, default_value_t = SplitRule::Random)]
    pub(super) split: SplitRule,
    /// Steps that an event is cut to; shorter events are left out
    #[arg(long, value_name = "N", default_value_t = 150)]
    pub(super) steps: u32,
    /// Seeds to learn with, separated by commas
    #[arg(long, value_name = "SEEDS", value_delimiter = ',', default_value = "42,43,44")]
    pub(super) seeds: Vec<String>,
    /// Strength of consolidation, for all methods (auto) or one of them; as often as needed [default: auto]
    #[arg(long, value_name = "METHOD=X|auto")]
    pub(super) strength: Vec<String>,
    /// The formula's λ instead of a strength; as often as needed
    #[arg(long, value_name = "METHOD=X")]
    pub(super) lambda: Vec<String>,
    /// Where settings come from that are not given: `best`, what drove best when measured, or `paper`, the paper's
    /// [default: best]
    #[arg(long, value_name = "NAME")]
    pub(super) preset: Option<String>,
    /// Hidden units [default: 128]
    #[arg(long, value_name = "N")]
    pub(super) hidden: Option<u32>,
    /// Passes over the events of each task [default: 5]
    #[arg(long, value_name = "N")]
    pub(super) epochs: Option<u32>,
    /// Any other setting of a model by its name, as often as needed
    #[arg(long = "set", value_name = "NAME=VALUE")]
    pub(super) settings: Vec<String>,
    /// The tasks in the order in which to learn them [default: fastest first]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(super) order: Option<Vec<String>>,
    /// Leave out the figures, and the training and measuring that is for them alone
    #[arg(long)]
    pub(super) no_figures: bool,
    /// Leave out the figure of error over λ, which trains a stage for each of its points
    #[arg(long)]
    pub(super) no_sweep: bool,
    /// Leave out the reference drivers
    #[arg(long)]
    pub(super) no_references: bool,
    /// Leave out the hard scenarios and the platoon
    #[arg(long)]
    pub(super) no_safety: bool,
    /// Threads [default: as many as there are cores]
    #[arg(long, value_name = "N")]
    pub(super) threads: Option<usize>,
    /// Take finished stages that another build of headway left in DIR; its arithmetic may differ
    #[arg(long)]
    pub(super) any_build: bool,
    /// Seconds of training that an interruption may cost
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0, value_parser = seconds)]
    pub(super) checkpoint_s: f64,
    /// Resamples behind each confidence interval
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(super) resamples: u32,
    /// Print the report as one JSON object on stdout too
    #[arg(long)]
    pub(super) json: bool,
}

/// How events are split where no file says it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum SplitRule {
    /// Inside each task, event by event.
    Random,
    /// Whole recordings.
    Run,
}

/// What tasks are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TaskRule {
    /// So many, by mean speed.
    Speed(usize),
    /// One a source.
    Source,
}

/// How strongly a method consolidates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Strength {
    /// To be found.
    Auto,
    /// The strength.
    Fixed(f64),
    /// The formula's number.
    Lambda(f64),
}

/// The arguments, read.
pub(super) struct Options {
    /// In the order given, each once.
    pub(super) methods: Vec<Method>,
    pub(super) tasks: TaskRule,
    pub(super) seeds: Vec<u64>,
    pub(super) settings: ModelSettings,
    strengths: BTreeMap<&'static str, Strength>,
}

impl Options {
    pub(super) fn read(arguments: &ReproduceArguments) -> anyhow::Result<Self> {
        let methods = distinct("--methods", &arguments.methods, |name| method("--methods", name))?;
        let seeds = distinct("--seeds", &arguments.seeds, |seed| {
            seed.parse().with_context(|| format!("--seeds: {seed:?} is not a whole number from 0 on"))
        })?;
        let settings = settings(arguments)?;
        for method in &methods {
            settings.check_for(*method).with_context(|| format!("method {}", method.as_str()))?;
        }
        let least = settings.horizon + MIN_DRIVEN_STEPS;
        ensure!(
            (least..=6000).contains(&arguments.steps),
            "--steps: {} is not within {least} to 6000",
            arguments.steps
        );
        ensure!(arguments.threads != Some(0), "--threads: at least one is needed");
        let mut options =
            Self { methods, tasks: tasks(arguments.tasks.as_deref())?, seeds, settings, strengths: BTreeMap::new() };
        options.read_strengths(arguments)?;
        Ok(options)
    }

    fn read_strengths(&mut self, arguments: &ReproduceArguments) -> anyhow::Result<()> {
        for text in arguments.strength.iter().filter(|text| *text != "auto") {
            let (name, value) =
                text.split_once('=').with_context(|| format!("--strength {text}: METHOD=X or auto is needed"))?;
            let strength =
                if value == "auto" { Strength::Auto } else { Strength::Fixed(number("--strength", text, value)?) };
            self.set_strength("--strength", name, strength)?;
        }
        for text in &arguments.lambda {
            let (name, value) = text.split_once('=').with_context(|| format!("--lambda {text}: METHOD=X is needed"))?;
            self.set_strength("--lambda", name, Strength::Lambda(number("--lambda", text, value)?))?;
        }
        Ok(())
    }

    fn set_strength(&mut self, flag: &str, name: &str, strength: Strength) -> anyhow::Result<()> {
        let method = method(flag, name)?;
        ensure!(method.consolidates(), "{flag}: {name} consolidates nothing, and has no strength");
        ensure!(self.methods.contains(&method), "{flag}: {name} is not among --methods");
        let before = self.strengths.insert(method.as_str(), strength);
        ensure!(before.is_none(), "{flag}: how strong {name} is was said twice");
        Ok(())
    }

    /// How strongly `method` consolidates.
    pub(super) fn strength(&self, method: Method) -> Strength {
        self.strengths.get(method.as_str()).copied().unwrap_or(Strength::Auto)
    }
}

fn settings(arguments: &ReproduceArguments) -> anyhow::Result<ModelSettings> {
    let mut overrides = Map::new();
    for text in &arguments.settings {
        let (name, value) = text.split_once('=').with_context(|| format!("--set {text}: NAME=VALUE is needed"))?;
        if let Some((_, flag)) =
            [("strength", "--strength"), ("lambda", "--lambda"), ("seed", "--seeds"), ("preset", "--preset")]
                .into_iter()
                .find(|(own, _)| *own == name)
        {
            bail!("--set {name}: {flag} says it");
        }
        // What is not JSON is a string: --set penalty_step=coupled.
        let value = serde_json::from_str(value).unwrap_or_else(|_| Value::from(value));
        overrides.insert(name.to_owned(), value);
    }
    if let Some(preset) = &arguments.preset {
        overrides.insert("preset".to_owned(), preset.as_str().into());
    }
    for (name, value) in [("hidden", arguments.hidden), ("epochs", arguments.epochs)] {
        if let Some(value) = value {
            overrides.insert(name.to_owned(), value.into());
        }
    }
    Ok(ModelSettings::default().overridden(&Value::Object(overrides))?)
}

fn tasks(rule: Option<&str>) -> anyhow::Result<TaskRule> {
    match rule {
        None => Ok(TaskRule::Speed(3)),
        Some("source") => Ok(TaskRule::Source),
        Some(count) => match count.parse() {
            Ok(count @ 2..=20) => Ok(TaskRule::Speed(count)),
            _ => bail!("--tasks: {count:?} is neither a number from 2 to 20 nor source"),
        },
    }
}

fn method(flag: &str, name: &str) -> anyhow::Result<Method> {
    serde_json::from_value(Value::from(name)).with_context(|| format!("{flag}: {name:?} is no method"))
}

fn number(flag: &str, text: &str, value: &str) -> anyhow::Result<f64> {
    let number: f64 = value.parse().with_context(|| format!("{flag} {text}: {value:?} is not a number"))?;
    ensure!(number.is_finite() && number >= 0.0, "{flag} {text}: a number from 0 on is needed");
    Ok(number)
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("a number from 0 to 86400 is needed".to_owned()),
    }
}

/// The values of a list, of which there is at least one and none twice.
fn distinct<X: PartialEq>(
    flag: &str,
    texts: &[String],
    read: impl Fn(&str) -> anyhow::Result<X>,
) -> anyhow::Result<Vec<X>> {
    let mut values = Vec::new();
    for text in texts.iter().map(|text| text.trim()).filter(|text| !text.is_empty()) {
        let value = read(text)?;
        ensure!(!values.contains(&value), "{flag}: {text} is there twice");
        values.push(value);
    }
    ensure!(!values.is_empty(), "{flag}: at least one is needed");
    Ok(values)
}
