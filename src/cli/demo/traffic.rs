//! Where the events come from, and what they look like on their way: one JSON object a line.

use std::ops::RangeInclusive;

use serde::Serialize;

use crate::car_following::{GeneratedEvent, TrafficRegime, TrafficSettings, generate};

/// Events without which a task is not worth learning: 15 % of them are for tests.
pub(super) const MIN_EVENTS: u32 = 20;

/// Events of each regime that can be asked for.
pub(super) const EVENTS_RANGE: RangeInclusive<i64> = MIN_EVENTS as i64..=100_000;

/// What the models will learn.
pub(super) struct Traffic {
    /// Where it comes from, for a reader.
    pub(super) origin: String,
    /// Where recorded events part into tasks, m/s.
    pub(super) split_mps: Option<[f64; 2]>,
    /// In the order in which they are learned.
    pub(super) regimes: Vec<RegimeTraffic>,
}

/// The events of one task.
pub(super) struct RegimeTraffic {
    pub(super) regime: TrafficRegime,
    /// One event a line.
    pub(super) ndjson: String,
    /// Events that are there and not used.
    pub(super) left_out: usize,
}

/// An event as it is sent; `N` is the type its numbers have.
#[derive(Serialize)]
pub(super) struct EventLine<'a, N> {
    pub(super) event_id: &'a str,
    pub(super) source: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) run: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) split: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) dt_s: Option<f64>,
    pub(super) spacing_m: &'a [N],
    pub(super) follower_speed_mps: &'a [N],
    pub(super) leader_speed_mps: &'a [N],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rel_speed_mps: Option<&'a [N]>,
}

impl<N: Serialize> EventLine<'_, N> {
    /// The event as one line.
    pub(super) fn line(&self) -> String {
        serde_json::to_string(self).expect("an event is plain data") + "\n"
    }
}

impl Traffic {
    /// `events` of each regime from the generator.
    pub(super) fn generated(seed: u64, events: u32) -> Self {
        let regimes = TrafficRegime::ALL.into_iter().map(|regime| {
            let drives = generate(regime, seed, events as usize, &TrafficSettings::default());
            RegimeTraffic { regime, ndjson: drives.iter().map(line).collect(), left_out: 0 }
        });
        let origin = format!("generated from seed {seed}, {events} events of each kind");
        Self { origin, split_mps: None, regimes: regimes.collect() }
    }
}

fn line(drive: &GeneratedEvent) -> String {
    let event = &drive.event;
    let line = EventLine {
        event_id: &drive.event_id,
        source: &drive.source,
        run: Some(&drive.run),
        split: None,
        dt_s: Some(event.dt_s()),
        spacing_m: event.spacing_m(),
        follower_speed_mps: event.follower_speed_mps(),
        leader_speed_mps: event.leader_speed_mps(),
        rel_speed_mps: None,
    };
    line.line()
}
