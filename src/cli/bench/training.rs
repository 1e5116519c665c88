//! `headway bench training`: updates and importance against the products that they are made of.

use anyhow::ensure;
use clap::Args;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::products::{Bench, PRODUCTS};
use super::table::{Figure, Findings};
use super::timing::seconds;
use crate::car_following::{Event, TrafficRegime, TrafficSettings, generate};
use crate::consolidation::{Kept, Method, importance};
use crate::driver::{Crew, DriverShape, Memory, Scaling};
use crate::lineage::{ModelSettings, Preset};
use crate::lstm::{initial_weights, kernel_name};
use crate::training::{StageInput, Unwatched, learn_stage};

/// Arguments of `headway bench training`.
#[derive(Debug, Args)]
pub(super) struct TrainingArguments {
    /// Hidden units
    #[arg(long, value_name = "N", default_value_t = 128)]
    hidden: u32,
    /// Events of an epoch, generated, of 150 steps each
    #[arg(long, value_name = "N", default_value_t = 256)]
    events: usize,
    /// How often everything is measured, in turn
    #[arg(long, value_name = "N", default_value_t = 5)]
    repeats: usize,
    /// Threads to train with, separated by commas
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [1, 2])]
    threads: Vec<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// What trains: a name for programs, one for people, and the settings.
fn configurations(hidden: u32) -> [(&'static str, &'static str, ModelSettings); 3] {
    let paper = ModelSettings { hidden, epochs: 1, ..Preset::Paper.settings() };
    let carried = ModelSettings { memory: Memory::Carried, ..paper.clone() };
    let best = ModelSettings { hidden, epochs: 1, ..Preset::Best.settings() };
    [
        ("window", "windows (preset paper)", paper),
        ("carried", "memory carried, else preset paper", carried),
        ("best", "preset best", best),
    ]
}

/// Operations of the recurrent products of one event, forward and twice that backward: a window's first step has none.
fn event_flop(shape: DriverShape, steps: usize) -> f64 {
    let products = (steps - shape.horizon) * (shape.horizon - 1);
    (3 * products * 2 * shape.layout().gates() * shape.hidden) as f64
}

struct Bencher<'a> {
    arguments: &'a TrainingArguments,
    events: &'a [Event],
    figures: Vec<Figure>,
}

/// Measures.
///
/// # Errors
/// When a number is out of range.
pub(super) fn run(arguments: &TrainingArguments) -> anyhow::Result<()> {
    ensure!(arguments.hidden > 0 && arguments.events > 0 && arguments.repeats > 0, "numbers must be positive");
    ensure!(!arguments.threads.is_empty() && !arguments.threads.contains(&0), "--threads: each at least 1");
    let lengths = TrafficSettings { min_steps: 150, max_steps: 150, ..TrafficSettings::default() };
    let generated = generate(TrafficRegime::Middle, 42, arguments.events, &lengths);
    let events: Vec<Event> = generated.into_iter().map(|generated| generated.event).collect();
    let mut bencher = Bencher { arguments, events: &events, figures: Vec::new() };
    bencher.products();
    bencher.updates()?;
    bencher.importance()?;
    let findings = Findings { kernel: kernel_name(), hidden: arguments.hidden as usize, figures: bencher.figures };
    findings.print(arguments.json)
}

impl Bencher<'_> {
    fn add(&mut self, name: String, says: String, unit: &'static str, samples: &[f64]) -> f64 {
        let figure = Figure::new(name, says, unit, samples);
        let median = figure.median();
        self.figures.push(figure);
        median
    }

    /// Each product on so many threads, each with matrices of its own.
    fn products(&mut self) {
        let shape = ModelSettings { hidden: self.arguments.hidden, ..Preset::Paper.settings() }.shape();
        let minibatch = Preset::Paper.settings().minibatch as usize;
        for which in PRODUCTS {
            // The weights' gradient is gathered over the steps of a piece.
            let rows = minibatch * (shape.horizon - 1) * if which == "weights" { 70 } else { 1 };
            for (library, multiply) in
                [("gemm", Bench::gemm as fn(&mut Bench, usize) -> f64), ("nalgebra", Bench::nalgebra)]
            {
                for &threads in &self.arguments.threads {
                    let mut benches: Vec<_> = (0..threads).map(|_| Bench::new(which, shape.layout(), rows)).collect();
                    let times = (2e9 / benches[0].flop()).ceil() as usize;
                    let mut sample = || -> f64 {
                        std::thread::scope(|scope| {
                            let each: Vec<_> =
                                benches.iter_mut().map(|bench| scope.spawn(|| multiply(bench, times))).collect();
                            each.into_iter().map(|thread| thread.join().expect("a product does not panic")).sum()
                        })
                    };
                    sample();
                    let samples: Vec<_> = (0..self.arguments.repeats).map(|_| sample()).collect();
                    let says = format!("product `{which}`, {rows} rows, {library}, {threads} at once");
                    self.add(format!("{library}_{which}_{threads}"), says, "GFLOP/s", &samples);
                }
            }
        }
    }

    fn updates(&mut self) -> anyhow::Result<()> {
        for (name, says, settings) in configurations(self.arguments.hidden) {
            let flop = event_flop(settings.shape(), self.events[0].steps());
            for &threads in &self.arguments.threads {
                let workers = ThreadPoolBuilder::new().num_threads(threads).build()?;
                self.epoch(&settings, &workers)?;
                let epochs: Result<Vec<f64>, _> =
                    (0..self.arguments.repeats).map(|_| self.epoch(&settings, &workers)).collect();
                let rates: Vec<_> = epochs?.into_iter().map(|s| self.events.len() as f64 / s).collect();
                let says = format!("training, {says}, {threads} threads");
                let rate = self.add(format!("{name}_{threads}"), says, "events/s", &rates);
                if name == "window" {
                    let says = format!("the same, its recurrent products alone, {threads} threads");
                    self.add(format!("{name}_gflops_{threads}"), says, "GFLOP/s", &[rate * flop / 1e9]);
                }
            }
        }
        Ok(())
    }

    /// Seconds in the updates of one epoch.
    fn epoch(&self, settings: &ModelSettings, workers: &ThreadPool) -> anyhow::Result<f64> {
        let input = StageInput {
            method: Method::Naive,
            settings: settings.learning(),
            stage: 1,
            regime: "middle",
            parent_weights: None,
            scaling: None,
            memory: &[],
            replay: &[],
            train: self.events,
            validation: &[],
        };
        Ok(learn_stage(&input, None, workers, &mut Unwatched)?.update_s)
    }

    fn importance(&mut self) -> anyhow::Result<()> {
        let events: Vec<&Event> = self.events.iter().collect();
        for (name, says, settings) in configurations(self.arguments.hidden) {
            let shape = settings.shape();
            let scaling = Scaling::estimate(shape, &events);
            let weights = initial_weights(shape.layout(), settings.seed);
            let options = settings.learning().importance;
            let &threads = self.arguments.threads.iter().max().expect("there are threads");
            let workers = ThreadPoolBuilder::new().num_threads(threads).build()?;
            let crew = Crew::<f32>::new(shape, &workers);
            if name == "carried" {
                continue; // Exact, it is a drive for every step.
            }
            for (kept, letter) in [(Kept::Fisher, "F"), (Kept::Sensitivity, "Ω")] {
                let mut samples = Vec::new();
                for _ in 0..self.arguments.repeats {
                    let epoch = self.epoch(&settings, &workers)?;
                    let pass = seconds(|| {
                        importance(kept, options, &crew, &scaling, &weights, &events, &mut || true)
                            .expect("nobody stops it");
                    });
                    samples.push(pass / epoch);
                }
                let says = format!("importance {letter} ({:?}), {says}, {threads} threads", options.estimator);
                self.add(format!("importance_{name}_{letter}"), says, "epochs", &samples);
            }
        }
        Ok(())
    }
}
