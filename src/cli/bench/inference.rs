//! `headway bench inference`: windows one by one and thousands together, and the steps of a vehicle's sequence.

use std::hint::black_box;

use anyhow::ensure;
use clap::Args;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::table::{Figure, Findings};
use super::timing::{median, quantile, seconds};
use crate::car_following::{Event, TrafficRegime, TrafficSettings, generate};
use crate::driver::{Driver, DriverBuffers, Scaling, Window};
use crate::lineage::{ModelSettings, Preset};
use crate::lstm::{initial_weights, kernel_name};

/// Arguments of `headway bench inference`.
#[derive(Debug, Args)]
pub(super) struct InferenceArguments {
    /// Hidden units
    #[arg(long, value_name = "N", default_value_t = 128)]
    hidden: u32,
    /// Windows that are answered together
    #[arg(long, value_name = "N", default_value_t = 4096)]
    windows: usize,
    /// Threads to answer them with, separated by commas
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [1, 2])]
    threads: Vec<usize>,
    /// How often everything is measured, in turn
    #[arg(long, value_name = "N", default_value_t = 5)]
    repeats: usize,
    /// Windows, and steps of a sequence, that are answered one by one in each of the repeats
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    singly: usize,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// What is measured with, and the samples: one for each repeat.
struct Bencher<'a> {
    arguments: &'a InferenceArguments,
    driver: Driver,
    windows: Vec<Window>,
    pools: Vec<ThreadPool>,
    single: Tails,
    sequence: Tails,
    together: Vec<Vec<f64>>,
}

/// Medians and 99th percentiles of many short times, µs.
#[derive(Default)]
struct Tails {
    medians: Vec<f64>,
    p99s: Vec<f64>,
}

impl Tails {
    fn add(&mut self, times_us: &[f64]) {
        self.medians.push(median(times_us));
        self.p99s.push(quantile(times_us, 0.99));
    }

    fn figures(&self, name: &str, says: &str) -> [Figure; 2] {
        let p99 = Figure::new(format!("{name}_p99"), format!("{says}, 99th percentile"), "µs", &self.p99s);
        [Figure::new(name, says, "µs", &self.medians), p99]
    }
}

/// Measures.
///
/// # Errors
/// When a number is out of range.
pub(super) fn run(arguments: &InferenceArguments) -> anyhow::Result<()> {
    let InferenceArguments { hidden, windows, repeats, singly, .. } = *arguments;
    ensure!(hidden > 0 && windows > 0 && repeats > 0 && singly > 0, "numbers must be positive");
    ensure!(!arguments.threads.is_empty() && !arguments.threads.contains(&0), "--threads: each at least 1");
    let mut bencher = Bencher::new(arguments)?;
    for _ in 0..repeats {
        bencher.one_by_one();
        bencher.step_by_step();
        bencher.all_together();
    }
    let findings = Findings { kernel: kernel_name(), hidden: hidden as usize, figures: bencher.figures() };
    findings.print(arguments.json)
}

impl<'a> Bencher<'a> {
    fn new(arguments: &'a InferenceArguments) -> anyhow::Result<Self> {
        let settings = ModelSettings { hidden: arguments.hidden, ..Preset::Paper.settings() };
        let shape = settings.shape();
        let windows = windows(shape.horizon, arguments.windows);
        let (mean, spread) = ([8.0, 8.5, 0.3, 14.0], [3.0, 3.5, 1.2, 5.0]);
        let scaling = Scaling { mean, spread, low: [0.0; 4], high: [40.0; 4], motion: None };
        let driver = Driver::new(shape, scaling, initial_weights(shape.layout(), 1)).expect("made for the shape");
        let pools = arguments.threads.iter().map(|&threads| ThreadPoolBuilder::new().num_threads(threads).build());
        let pools = pools.collect::<Result<Vec<_>, _>>()?;
        let together = vec![Vec::new(); pools.len()];
        Ok(Self { arguments, driver, windows, pools, single: Tails::default(), sequence: Tails::default(), together })
    }

    fn one_by_one(&mut self) {
        let mut buffers = DriverBuffers::default();
        let windows = self.windows.chunks(1).cycle().take(self.arguments.singly);
        let times: Vec<f64> = windows
            .map(|window| {
                let mut accel_mps2 = [0.0];
                let work = || self.driver.accelerations_into(black_box(window), &mut buffers, &mut accel_mps2);
                let time = 1e6 * seconds(work);
                black_box(accel_mps2);
                time
            })
            .collect();
        self.single.add(&times);
    }

    fn step_by_step(&mut self) {
        let mut sequence = self.driver.sequence();
        let steps = self.windows.iter().cycle().take(self.arguments.singly).map(|window| window.seen(0));
        let times: Vec<f64> = steps
            .map(|seen| {
                1e6 * seconds(|| {
                    black_box(self.driver.next_acceleration(&mut sequence, black_box(seen)));
                })
            })
            .collect();
        self.sequence.add(&times);
    }

    /// Each thread answers one piece, as the server does.
    fn all_together(&mut self) {
        let mut accel_mps2 = vec![0.0; self.windows.len()];
        for (pool, samples) in self.pools.iter().zip(&mut self.together) {
            let each = self.windows.len().div_ceil(pool.current_num_threads());
            let pieces = self.windows.par_chunks(each).zip(accel_mps2.par_chunks_mut(each));
            let answer = |(windows, accel_mps2): (&[Window], &mut [f32])| {
                self.driver.accelerations_into(windows, &mut DriverBuffers::default(), accel_mps2);
            };
            let time = seconds(|| pool.install(|| pieces.for_each(answer)));
            samples.push(1e6 * time / self.windows.len() as f64);
            black_box(&accel_mps2);
        }
    }

    fn figures(&self) -> Vec<Figure> {
        let mut figures = Vec::from(self.single.figures("single_window", "one window"));
        figures.extend(self.sequence.figures("sequence_step", "the newest step of a sequence"));
        for (threads, samples) in self.arguments.threads.iter().zip(&self.together) {
            let (name, plural) = (format!("windows_{threads}_threads"), if *threads > 1 { "s" } else { "" });
            let says = format!("a window of {}, {threads} thread{plural}", self.windows.len());
            figures.push(Figure::new(name, says, "µs", samples));
        }
        figures
    }
}

/// Windows of generated traffic.
fn windows(horizon: usize, count: usize) -> Vec<Window> {
    let of_event = |event: &Event| -> Vec<Window> {
        let cut = |values: &[f32]| values.windows(horizon).map(<[f32]>::to_vec).collect::<Vec<_>>();
        let speeds = cut(event.follower_speed_mps()).into_iter().zip(cut(event.leader_speed_mps()));
        let window = |((follower_speed_mps, leader_speed_mps), spacing_m)| Window {
            follower_speed_mps,
            leader_speed_mps,
            spacing_m,
        };
        speeds.zip(cut(event.spacing_m())).map(window).collect()
    };
    let lengths = TrafficSettings::default();
    let events = generate(TrafficRegime::Middle, 42, count.div_ceil(lengths.min_steps - horizon), &lengths);
    events.into_iter().flat_map(|generated| of_event(&generated.event)).take(count).collect()
}
