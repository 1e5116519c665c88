//! How far a task is, on stderr: a bar on a terminal, short lines elsewhere.

use std::io::{IsTerminal, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::service::Advance;

/// Ticks of a full bar.
const FULL: u64 = 1000;

/// How far one task is.
pub(super) enum Progress {
    /// On a terminal.
    Bar(ProgressBar),
    /// Elsewhere: a line for each pass over the events.
    Lines { label: String, epoch: u64 },
}

impl Progress {
    pub(super) fn new(model: &str, regime: &str) -> Self {
        let label = format!("{model:<5}  {regime}");
        if !std::io::stderr().is_terminal() {
            return Self::Lines { label, epoch: 0 };
        }
        let style = ProgressStyle::with_template("  {prefix:<14} [{bar:30}] {percent:>3} %  {elapsed}  {msg}");
        let bar = ProgressBar::new(FULL).with_style(style.expect("a template without mistakes")).with_prefix(label);
        bar.enable_steady_tick(Duration::from_millis(200));
        Self::Bar(bar)
    }

    pub(super) fn show(&mut self, advance: &Advance) {
        let loss = advance.loss.map_or_else(String::new, |loss| format!(", loss {loss:.3}"));
        match self {
            Self::Bar(bar) => {
                bar.set_position((advance.progress * FULL as f64) as u64);
                let speed = advance.events_per_s.map_or_else(String::new, |speed| format!(", {speed:.0} events/s"));
                bar.set_message(format!("epoch {}{loss}{speed}", advance.epoch));
            }
            Self::Lines { label, epoch } => {
                if advance.epoch > *epoch {
                    *epoch = advance.epoch;
                    // Nobody needs these lines: a stderr that is gone ends nothing.
                    let _ = writeln!(std::io::stderr(), "  {label}, epoch {epoch}{loss}");
                }
            }
        }
    }

    /// The task has ended.
    pub(super) fn end(self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}
