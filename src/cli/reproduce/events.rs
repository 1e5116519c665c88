//! The events of the files: converted, checked, cut, and what was left out with the reason.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde::Serialize;

use crate::car_following::{CheckSettings, Conversion, Event, Recording, Target};
use crate::cli::recordings;
use crate::formats::RawEvent;
use crate::lineage::Split;

/// Closer than this within the cut, an event is left out, m.
const LEAST_SPACING_M: f32 = 0.5;
/// Examples of each reason that are kept.
const EXAMPLES: usize = 3;

/// An event at the model's step, cut.
pub(super) struct CutEvent {
    pub(super) event_id: String,
    pub(super) source: String,
    /// Of which recording it is a part; itself when it names none.
    pub(super) run: String,
    /// The side it names itself.
    pub(super) split: Option<Split>,
    pub(super) event: Event,
    pub(super) content: [u8; 32],
    pub(super) mean_speed_mps: f64,
}

/// The events of one file that were left out for one reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct LeftOut {
    pub(super) file: String,
    pub(super) reason: String,
    pub(super) events: usize,
    pub(super) examples: Vec<String>,
}

/// How many events a file gave.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct FileCount {
    pub(super) file: String,
    pub(super) events: usize,
    pub(super) kept: usize,
}

/// All files.
#[derive(Default)]
pub(super) struct Recorded {
    pub(super) events: Vec<CutEvent>,
    pub(super) files: Vec<FileCount>,
    pub(super) left_out: Vec<LeftOut>,
    /// Events with the same numbers as one before them, cut; they take part as the protocol has it.
    pub(super) copies: usize,
    seen: HashSet<[u8; 32]>,
}

impl Recorded {
    /// Reads every file; events are cut to `steps` steps of `dt_s`.
    pub(super) fn read(files: &[PathBuf], steps: usize, dt_s: f64) -> anyhow::Result<Self> {
        let mut recorded = Self::default();
        for path in files {
            recorded.add(path, steps, dt_s).with_context(|| format!("cannot read {}", path.display()))?;
        }
        if recorded.events.is_empty() {
            bail!("no event is left: {}", recorded.reasons());
        }
        Ok(recorded)
    }

    fn add(&mut self, path: &Path, steps: usize, dt_s: f64) -> anyhow::Result<()> {
        let (file, source) = (path.display().to_string(), recordings::source_name(path));
        let read = recordings::read(path)?;
        let (events, before) = (read.len(), self.events.len());
        for decoded in read {
            let (id, cut) = match decoded {
                Ok(raw) => (raw.event_id.clone(), cut(raw, &source, steps, dt_s)),
                Err(rejection) => {
                    (rejection.event_id.clone().unwrap_or_default(), Err(format!("unreadable ({})", rejection.code)))
                }
            };
            match cut {
                Ok(event) => {
                    self.copies += usize::from(!self.seen.insert(event.content));
                    self.events.push(event);
                }
                Err(reason) => self.leave_out(&file, &id, reason),
            }
        }
        self.files.push(FileCount { file, events, kept: self.events.len() - before });
        Ok(())
    }

    fn leave_out(&mut self, file: &str, id: &str, reason: String) {
        let place = self.left_out.iter().position(|known| known.file == file && known.reason == reason);
        let place = place.unwrap_or_else(|| {
            self.left_out.push(LeftOut { file: file.to_owned(), reason, events: 0, examples: Vec::new() });
            self.left_out.len() - 1
        });
        let left_out = &mut self.left_out[place];
        left_out.events += 1;
        if left_out.examples.len() < EXAMPLES {
            left_out.examples.push(id.to_owned());
        }
    }

    /// Why events were left out, in one line.
    pub(super) fn reasons(&self) -> String {
        if self.left_out.is_empty() {
            let files: Vec<_> = self.files.iter().map(|file| file.file.as_str()).collect();
            return format!("{} {} none", files.join(", "), if files.len() == 1 { "holds" } else { "hold" });
        }
        let each = self.left_out.iter().map(|left| format!("{} of {}: {}", left.events, left.file, left.reason));
        each.collect::<Vec<_>>().join("; ")
    }
}

/// The event at the model's step, cut to `steps`; only what is kept of it is checked.
fn cut(mut raw: RawEvent, file_source: &str, steps: usize, dt_s: f64) -> Result<CutEvent, String> {
    shorten(&mut raw.recording, steps, dt_s);
    let declared = raw.recording.dt_s.is_some() || raw.recording.t_s.is_some();
    let conversion = Conversion { dt_s: (!declared).then_some(dt_s), ..Conversion::default() };
    let target = Target { dt_s, min_steps: 0, max_steps: usize::MAX };
    let event = CheckSettings::default().check(&raw.recording, &conversion, &target).map_err(|defects| {
        let codes: Vec<_> = defects.iter().map(|defect| defect.code).collect();
        format!("refused by the physics checks ({})", codes.join(", "))
    })?;
    let event = event.resample(dt_s);
    if event.steps() < steps {
        return Err(format!("shorter than {steps} steps of {dt_s} s"));
    }
    let first = |values: &[f32]| values[..steps].to_vec();
    let event =
        Event::new(dt_s, first(event.spacing_m()), first(event.follower_speed_mps()), first(event.leader_speed_mps()));
    if event.spacing_m().iter().any(|&spacing| spacing < LEAST_SPACING_M) {
        return Err(format!("closer than {LEAST_SPACING_M} m within {steps} steps"));
    }
    let source = raw.source.unwrap_or_else(|| file_source.to_owned());
    let run = match raw.run {
        Some(run) => format!("{source}/{run}"),
        None => format!("{source}//{}", raw.event_id),
    };
    Ok(CutEvent {
        run,
        source,
        split: raw.split,
        content: event.content_sha256(),
        mean_speed_mps: event.mean_speed_mps(),
        event_id: raw.event_id,
        event,
    })
}

/// Drops the steps after those that make `steps` of `dt_s`: what comes later is not used, and need not be right.
fn shorten(recording: &mut Recording, steps: usize, dt_s: f64) {
    let own = recording.dt_s.or_else(|| {
        let times = recording.t_s.as_deref()?;
        Some((times.last()? - times.first()?) / (times.len().checked_sub(1)? as f64))
    });
    let own = own.unwrap_or(dt_s);
    if !(own > 0.0 && own.is_finite()) {
        return;
    }
    // One more than needed forgives rounding.
    let kept = ((steps - 1) as f64 * dt_s / own).ceil() as usize + 1 + usize::from((own - dt_s).abs() > 1e-9);
    for values in [&mut recording.spacing_m, &mut recording.follower_speed_mps, &mut recording.leader_speed_mps] {
        values.truncate(kept);
    }
    for values in [&mut recording.rel_speed_mps, &mut recording.t_s].into_iter().flatten() {
        values.truncate(kept);
    }
}
