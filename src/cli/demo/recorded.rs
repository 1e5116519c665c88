//! Recorded events: files as an upload takes them, parted into three tasks.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::thirds::Thirds;
use super::traffic::{EventLine, MIN_EVENTS, RegimeTraffic, Traffic};
use crate::car_following::{Recording, TrafficRegime};
use crate::cli::recordings;
use crate::formats::RawEvent;
use crate::lineage::Split;

/// An event of a file, with what it is sorted by.
struct Recorded {
    raw: RawEvent,
    source: String,
    mean_speed_mps: f64,
}

/// The events of `files` in three tasks, of at most `most` events each.
pub(super) fn traffic(files: &[PathBuf], most: u32) -> anyhow::Result<Traffic> {
    let (mut events, mut unreadable) = (Vec::new(), 0);
    for path in files {
        let read = read(path).with_context(|| format!("cannot read {}", path.display()))?;
        unreadable += read.unreadable;
        events.extend(read.events);
    }
    let speeds: Vec<f64> = events.iter().map(|event| event.mean_speed_mps).collect();
    if speeds.is_empty() {
        bail!("no event could be read");
    }
    let thirds = Thirds::of(&speeds);
    let regimes = TrafficRegime::ALL.into_iter().map(|regime| {
        let of_regime: Vec<_> = events.iter().filter(|event| thirds.regime(event.mean_speed_mps) == regime).collect();
        part(regime, &of_regime, most as usize)
    });
    let [low, high] = thirds.split_mps();
    let unread = if unreadable > 0 { format!(", {unreadable} more could not be read") } else { String::new() };
    let origin = format!(
        "{} recorded events{unread}, in thirds that part at mean follower speeds of {low:.2} and {high:.2} m/s",
        events.len()
    );
    Ok(Traffic { origin, split_mps: Some([low, high]), regimes: regimes.collect::<anyhow::Result<_>>()? })
}

/// The events of one task: when there are too many, as many as may be, spread evenly, so that every recording has its share.
fn part(regime: TrafficRegime, events: &[&Recorded], most: usize) -> anyhow::Result<RegimeTraffic> {
    let count = events.len();
    if count < MIN_EVENTS as usize {
        let name = regime.as_str();
        bail!("only {count} events are {name} traffic, and each third needs {MIN_EVENTS}; name files with more events");
    }
    let kept = count.min(most);
    let ndjson = (0..kept).map(|i| line(events[i * count / kept])).collect();
    Ok(RegimeTraffic { regime, ndjson, left_out: count - kept })
}

fn line(event: &Recorded) -> String {
    let (raw, recording) = (&event.raw, &event.raw.recording);
    let line = EventLine {
        event_id: &raw.event_id,
        source: &event.source,
        run: raw.run.as_deref(),
        split: raw.split.map(Split::as_str),
        dt_s: recording.dt_s.or_else(|| mean_step(recording)),
        spacing_m: &recording.spacing_m,
        follower_speed_mps: &recording.follower_speed_mps,
        leader_speed_mps: &recording.leader_speed_mps,
        rel_speed_mps: recording.rel_speed_mps.as_deref(),
    };
    line.line()
}

/// A JSON event says its step, not its times.
fn mean_step(recording: &Recording) -> Option<f64> {
    match recording.t_s.as_deref()? {
        [first, .., last] => Some((last - first) / (recording.t_s.as_ref()?.len() - 1) as f64),
        _ => None,
    }
}

/// What a file holds.
struct Contents {
    events: Vec<Recorded>,
    unreadable: usize,
}

fn read(path: &Path) -> anyhow::Result<Contents> {
    let source = recordings::source_name(path);
    let read = recordings::read(path)?;
    let all = read.len();
    let events: Vec<_> = read.into_iter().flatten().filter_map(|raw| recorded(raw, &source)).collect();
    Ok(Contents { unreadable: all - events.len(), events })
}

/// With its mean speed; none when it has no finite one.
fn recorded(raw: RawEvent, file_source: &str) -> Option<Recorded> {
    let speeds = &raw.recording.follower_speed_mps;
    let mean_speed_mps = speeds.iter().sum::<f64>() / speeds.len() as f64;
    let source = raw.source.clone().unwrap_or_else(|| file_source.to_owned());
    mean_speed_mps.is_finite().then_some(Recorded { raw, source, mean_speed_mps })
}
