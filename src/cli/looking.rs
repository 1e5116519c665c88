//! How far a look at a database is: a bar on a terminal, nothing elsewhere.

use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::store::verify::Looking;

/// Ticks of a full bar of a share.
const FULL: u64 = 1000;

/// On stderr, and on a terminal only.
#[derive(Clone)]
pub(super) struct Bar(ProgressBar);

impl Bar {
    pub(super) fn new() -> Self {
        if !std::io::stderr().is_terminal() {
            return Self(ProgressBar::hidden());
        }
        let style = ProgressStyle::with_template("  {msg:<24} [{bar:30}] {human_pos:>12} / {human_len}  {elapsed}");
        let bar = ProgressBar::new(0).with_style(style.expect("a template without mistakes"));
        bar.enable_steady_tick(Duration::from_millis(200));
        Self(bar)
    }

    pub(super) fn show(&self, looking: Looking) {
        self.at(looking.check, looking.done, looking.of.max(looking.done));
    }

    /// A share done, 0–1.
    pub(super) fn share(&self, what: &str, share: f64) {
        self.at(what, (share * FULL as f64) as u64, FULL);
    }

    fn at(&self, what: &str, done: u64, of: u64) {
        self.0.set_length(of);
        self.0.set_position(done);
        if self.0.message() != what {
            self.0.set_message(what.to_owned());
        }
    }

    pub(super) fn end(&self) {
        self.0.finish_and_clear();
    }
}
