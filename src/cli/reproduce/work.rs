//! Learning every stage that is not there yet, and driving it on the test events of every task.

use std::collections::BTreeSet;
use std::time::Duration;

use anyhow::{Context, anyhow};
use rayon::ThreadPool;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use super::arguments::{Options, ReproduceArguments, Strength};
use super::measured::Measured;
use super::observer::{StageObserver, Trace};
use super::plan::{Plan, Task};
use super::progress::Progress;
use super::state::{State, StoredStage};
use crate::car_following::Event;
use crate::consolidation::Method;
use crate::driver::Scaling;
use crate::lineage::{self, ModelSettings};
use crate::lstm::kernel_name;
use crate::training::{LearnSettings, Learned, Line, ReplayedRegime, StageInput, learn_stage};

/// What decides a result besides what [`Stage`] says; changed whenever stored stages would mean something else.
const FORMAT: &str = "headway reproduce 3";

/// The experiment under way.
pub(super) struct Work<'a> {
    pub(super) plan: &'a Plan,
    pub(super) options: &'a Options,
    pub(super) workers: ThreadPool,
    pub(super) progress: Progress,
    state: State,
    checkpoint_every: Duration,
    /// Training events of all tasks, for `joint`.
    all: Vec<Event>,
    /// Of every task, for methods that replay.
    replay: Vec<ReplayedRegime>,
    /// Of the first task's training events: what all models of the experiment standardise with.
    scaling: Scaling,
    /// Digest of build and data.
    base: String,
    /// Whether the first seed's stages are measured on their way.
    traced: bool,
}

/// One stage of one line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stage {
    pub(super) method: Method,
    pub(super) seed: u64,
    /// From 1; that of the last task for `joint`, which learns them all at once.
    pub(super) number: u32,
    pub(super) strength: Strength,
    /// What the stage is for, beside the tables.
    pub(super) traced: bool,
}

impl<'a> Work<'a> {
    pub(super) fn new(arguments: &ReproduceArguments, options: &'a Options, plan: &'a Plan) -> anyhow::Result<Self> {
        let threads = arguments.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
        let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let mut first: Vec<&Event> = plan.tasks[0].train.iter().collect();
        first.sort_by_cached_key(|event| event.content_sha256());
        Ok(Self {
            plan,
            options,
            workers,
            progress: Progress::new(),
            state: State::open(&arguments.out)?,
            checkpoint_every: Duration::from_secs_f64(arguments.checkpoint_s),
            all: plan.train_all(),
            replay: plan.tasks.iter().map(|task| replayed(task, options.settings.replay_events as usize)).collect(),
            scaling: Scaling::estimate(options.settings.shape(), &first),
            base: base(arguments, plan)?,
            traced: !arguments.no_figures,
        })
    }

    /// The stages of `method` with `seed`, in order.
    pub(super) fn stages(&self, method: Method, seed: u64, strength: Strength) -> Vec<Stage> {
        let last = self.plan.tasks.len() as u32;
        let first = if method == Method::Joint { last } else { 1 };
        let stage = |number| {
            let traced = self.traced && seed == self.options.seeds[0] && number > 1 && method != Method::Joint;
            Stage { method, seed, number, strength, traced }
        };
        (first..=last).map(stage).collect()
    }

    /// Says what is there and what is left to do, and prepares the progress bar for it.
    pub(super) fn survey(&mut self, stages: &[Stage]) {
        let (mut known, mut there, mut events) = (BTreeSet::new(), 0, 0.0);
        for stage in stages {
            let key = self.key(stage);
            there += usize::from(self.state.has(&key));
            // What several methods share is learned once.
            let learned_as = stage.learned_as();
            let shared = self.key(&learned_as);
            if !self.state.has(&key) && !self.state.has(&shared) && !known.contains(&shared) {
                events += self.trained(&learned_as);
            }
            known.extend([key, shared]);
        }
        if there > 0 {
            self.progress.say(&format!("{there} of {} stages are there already", stages.len()));
        }
        let others = self.state.others(&known);
        if others > 0 {
            let what = "stages in the folder are of other events, other settings or another build";
            self.progress.say(&format!("{others} {what}: they stay, and are not used"));
        }
        self.progress.begin(stages.len(), events);
    }

    /// The line of these stages: each from disk when it is there, else learned.
    pub(super) fn line(&self, stages: &[Stage]) -> anyhow::Result<Vec<StoredStage>> {
        let mut line = Line::default();
        let mut done = Vec::with_capacity(stages.len());
        for stage in stages {
            let stored = self.stage(stage, &line)?;
            line.advance(&stored.learned);
            done.push(stored);
        }
        Ok(done)
    }

    /// One stage that starts from `line`.
    pub(super) fn stage(&self, stage: &Stage, line: &Line) -> anyhow::Result<StoredStage> {
        let (stored, fresh) = self.obtain(stage, line)?;
        self.progress.ended(fresh.then(|| (stage.words(self.plan), self.trained(stage) / stored.learned.update_s)));
        Ok(stored)
    }

    /// The stage, and whether it had to be learned.
    fn obtain(&self, stage: &Stage, line: &Line) -> anyhow::Result<(StoredStage, bool)> {
        let key = self.key(stage);
        match self.state.stage(&key) {
            Ok(Some(stored)) => return Ok((stored, false)),
            Ok(None) => {}
            Err(error) => {
                self.progress.say(&format!("{} is damaged ({error:#}): it is learned again", stage.words(self.plan)));
            }
        }
        let shape = self.settings(stage).shape;
        let mut trace = stage.traced.then(|| Trace::new(self.plan, shape, &self.workers));
        let learned = if *stage == stage.learned_as() {
            self.learn(stage, line, &key, trace.as_mut())?
        } else {
            self.consolidate(stage)?
        };
        let measured = Measured::of(&learned, shape, &self.plan.tasks, &self.workers);
        let stored = StoredStage { measured, learned, trace: trace.map_or_else(Vec::new, Trace::points) };
        self.state.keep_stage(&key, &stored)?;
        Ok((stored, true))
    }

    /// What `told` says in full, from disk when it is there, else made.
    pub(super) fn kept<X: Serialize + DeserializeOwned>(
        &self,
        told: &str,
        kind: &str,
        make: impl FnOnce() -> anyhow::Result<X>,
    ) -> anyhow::Result<X> {
        let key = hex::encode(&Sha256::digest(format!("{} {told}", self.base))[..16]);
        match self.state.other(&key, kind) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => {}
            Err(error) => self.progress.say(&format!("a {kind} is damaged ({error:#}): it is made again")),
        }
        let made = make()?;
        self.state.keep_other(&key, kind, &made)?;
        Ok(made)
    }

    fn learn(
        &self,
        stage: &Stage,
        line: &Line,
        key: &str,
        mut trace: Option<&mut Trace<'_>>,
    ) -> anyhow::Result<Learned> {
        let half = self.state.half(key).unwrap_or_else(|error| {
            self.progress.say(&format!("half of {} is damaged ({error:#}): it starts again", stage.words(self.plan)));
            None
        });
        let resume = half.map(|half| {
            if let Some(trace) = &mut trace {
                trace.resume(half.trace);
            }
            half.checkpoint
        });
        let mut observer = StageObserver::new(&self.state, key, &self.progress, self.checkpoint_every, trace);
        let input = self.input(stage, line);
        self.progress.stage(self.trained(stage));
        let learned = learn_stage(&input, resume.as_deref(), &self.workers, &mut observer);
        observer.end()?;
        learned.map_err(|error| anyhow!(error)).with_context(|| stage.words(self.plan))
    }

    /// Stage 1 has nothing to hold on to yet: the weights are naive's, and only what is kept of them is the method's own.
    fn consolidate(&self, stage: &Stage) -> anyhow::Result<Learned> {
        let first = self.obtain(&stage.learned_as(), &Line::default())?.0.learned;
        let line = Line { stages: 0, weights: Some(first.weights), scaling: Some(first.scaling), memory: Vec::new() };
        let mut input = self.input(stage, &line);
        input.settings.epochs = 0;
        let mut observer = StageObserver::new(&self.state, "", &self.progress, Duration::MAX, None);
        let learned = learn_stage(&input, None, &self.workers, &mut observer)?;
        Ok(Learned { update_s: first.update_s, ..learned })
    }

    fn input<'s>(&'s self, stage: &Stage, line: &'s Line) -> StageInput<'s> {
        StageInput {
            method: stage.method,
            settings: self.settings(stage),
            stage: stage.number,
            regime: &self.plan.tasks[stage.number as usize - 1].name,
            parent_weights: line.weights.as_deref(),
            scaling: Some(line.scaling.unwrap_or(self.scaling)),
            memory: &line.memory,
            replay: if stage.method.replays() { &self.replay[..stage.number as usize - 1] } else { &[] },
            train: self.train(stage),
            validation: &[],
        }
    }

    fn train(&self, stage: &Stage) -> &[Event] {
        match stage.method {
            Method::Joint => &self.all,
            _ => &self.plan.tasks[stage.number as usize - 1].train,
        }
    }

    /// Training events of the stage times its epochs.
    pub(super) fn trained(&self, stage: &Stage) -> f64 {
        self.train(stage).len() as f64 * f64::from(self.options.settings.epochs)
    }

    fn settings(&self, stage: &Stage) -> LearnSettings {
        self.model_settings(stage).learning()
    }

    fn model_settings(&self, stage: &Stage) -> ModelSettings {
        let mut settings = ModelSettings { seed: stage.seed, ..self.options.settings.clone() };
        match stage.strength {
            // Nothing is held yet at stage 1, so that its result is one for all strengths.
            _ if stage.number == 1 => {}
            Strength::Auto => {}
            Strength::Fixed(strength) => settings.strength = Some(lineage::Strength::Fixed(strength)),
            Strength::Lambda(lambda) => settings.lambda = Some(lambda),
        }
        settings
    }

    /// Digest of everything that a stage's result depends on: its data and build, and what came before it on its line.
    fn key(&self, stage: &Stage) -> String {
        let mut hasher = Sha256::new();
        hasher.update(&self.base);
        for number in 1..=stage.number {
            let one = Stage { number, ..stage.clone() };
            let one = if number == 1 && stage.number > 1 { Stage { traced: false, ..one } } else { one };
            let settings = serde_json::to_string(&self.model_settings(&one)).expect("settings are plain data");
            hasher.update(format!(
                "{} {number} {} {settings}\n",
                stage.method.as_str(),
                one.traced && number == stage.number
            ));
        }
        hex::encode(&hasher.finalize()[..16])
    }
}

impl Stage {
    /// The stage whose learning gives this one's weights: naive's for stage 1 of the methods that only consolidate after it.
    fn learned_as(&self) -> Self {
        match self.method {
            Method::Naive | Method::Joint => self.clone(),
            // What follows the path of a stage has to go it.
            method if self.number > 1 || method.follows_path() => self.clone(),
            _ => Self { method: Method::Naive, strength: Strength::Auto, ..self.clone() },
        }
    }

    /// For a person.
    fn words(&self, plan: &Plan) -> String {
        let (method, seed) = (self.method.as_str(), self.seed);
        if self.method == Method::Joint {
            return format!("{method}, seed {seed}, all tasks at once");
        }
        let strength = match self.strength {
            Strength::Auto => String::new(),
            Strength::Fixed(strength) => format!(", strength {strength}"),
            Strength::Lambda(lambda) => format!(", λ {lambda}"),
        };
        let task = &plan.tasks[self.number as usize - 1].name;
        format!("{method}{strength}, seed {seed}, stage {}: {task}", self.number)
    }
}

/// The training events of least digest, as a server takes them.
fn replayed(task: &Task, events: usize) -> ReplayedRegime {
    let mut sorted: Vec<_> = task.train.iter().map(|event| (event.content_sha256(), event)).collect();
    sorted.sort_by_key(|(digest, _)| *digest);
    let events = sorted.into_iter().take(events).map(|(_, event)| event.clone());
    ReplayedRegime { regime: task.name.clone(), events: events.collect() }
}

/// Digest of the build and of every event, in its role.
fn base(arguments: &ReproduceArguments, plan: &Plan) -> anyhow::Result<String> {
    let mut hasher = Sha256::new();
    hasher.update(format!("{FORMAT} {} {}\n", env!("CARGO_PKG_VERSION"), kernel_name()));
    if !arguments.any_build {
        let build = std::env::current_exe().and_then(std::fs::read).context("cannot read the program itself")?;
        hasher.update(Sha256::digest(build));
    }
    for task in &plan.tasks {
        hasher.update(format!("task {}\n", task.name));
        for events in [&task.train, &task.validation, &task.test] {
            hasher.update((events.len() as u64).to_le_bytes());
            for event in events {
                hasher.update(event.content_sha256());
            }
        }
    }
    Ok(hex::encode(hasher.finalize()))
}
