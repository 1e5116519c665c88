//! How far the experiment is, on stderr: a bar with the time left on a terminal, a line for each stage elsewhere.

use std::cell::Cell;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};

use crate::training;

/// How far all stages together are.
pub(super) struct Progress {
    bar: Option<ProgressBar>,
    stages: usize,
    ended: Cell<usize>,
    /// Training events times epochs that are to be learned.
    events: f64,
    learned: Cell<f64>,
    /// Of the stage under way.
    share: Cell<f64>,
    of_stage: Cell<f64>,
    began: Instant,
}

impl Progress {
    pub(super) fn new() -> Self {
        Self {
            bar: std::io::stderr().is_terminal().then(ProgressBar::hidden),
            stages: 0,
            ended: Cell::new(0),
            events: 0.0,
            learned: Cell::new(0.0),
            share: Cell::new(0.0),
            of_stage: Cell::new(0.0),
            began: Instant::now(),
        }
    }

    /// What is to be done: stages in all, and training events times epochs to be learned.
    pub(super) fn begin(&mut self, stages: usize, events: f64) {
        (self.stages, self.events) = (stages, events);
        self.began = Instant::now();
        if self.bar.is_some() {
            let template = "  {prefix} [{bar:30}] {percent:>3} %  {elapsed}, {msg}";
            let style = ProgressStyle::with_template(template).expect("a template without mistakes");
            let bar = ProgressBar::new(events.max(1.0) as u64).with_style(style);
            bar.enable_steady_tick(Duration::from_millis(200));
            self.bar = Some(bar);
        }
    }

    /// A line that stays.
    pub(super) fn say(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| print(line)),
            None => print(line),
        }
    }

    /// An update of the stage under way.
    pub(super) fn updated(&self, progress: &training::Progress) {
        self.share.set(progress.update as f64 / progress.updates.max(1) as f64);
        let Some(bar) = &self.bar else { return };
        bar.set_position((self.learned.get() + self.share.get() * self.of_stage.get()) as u64);
        bar.set_prefix(format!("{}/{}", self.ended.get() + 1, self.stages));
        let left = self.left().map_or_else(String::new, |left| format!("about {} left, ", HumanDuration(left)));
        bar.set_message(format!("{left}loss {:.2}, {:.0} events/s", progress.loss, progress.events_per_s));
    }

    /// Training events times epochs of the stage that begins.
    pub(super) fn stage(&self, events: f64) {
        self.learned.set(self.learned.get() + self.share.replace(0.0) * self.of_stage.replace(events));
    }

    /// A stage is done; with its name and speed, events/s, when it was learned just now.
    pub(super) fn ended(&self, learned: Option<(String, f64)>) {
        self.ended.set(self.ended.get() + 1);
        self.learned.set(self.learned.get() + self.share.replace(0.0) * self.of_stage.get());
        let Some((words, speed)) = learned else { return };
        let left = self.left().map_or_else(String::new, |left| format!(", about {} left", HumanDuration(left)));
        self.say(&format!("[{}/{}] {words}: {speed:.0} events/s{left}", self.ended.get(), self.stages));
    }

    fn left(&self) -> Option<Duration> {
        let done = self.learned.get() + self.share.get() * self.of_stage.get();
        let per_event = self.began.elapsed().as_secs_f64() / done;
        let left = per_event * (self.events - done).max(0.0);
        (done > 0.0 && left.is_finite()).then(|| Duration::from_secs(left as u64))
    }

    /// Nothing more to learn.
    pub(super) fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn print(line: &str) {
    // Nobody needs these lines: a stderr that is gone ends nothing.
    let _ = writeln!(std::io::stderr(), "{line}");
}
