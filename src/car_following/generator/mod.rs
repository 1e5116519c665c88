//! Generated traffic: events of three regimes, for the demonstration and for tests without recorded data.
//!
//! The regimes differ in what drivers do, not only in how fast they go, as recorded data does: in motorway traffic
//! followers behave like adaptive cruise controls with long headways, in congestion like impatient people.
//! Everything is a pure function of (seed, regime, index); an event is the same whatever is generated beside it.

mod follower;
mod leader;
mod noise;

use super::Event;
use follower::Follower;
use leader::leader_speeds;
use noise::Noise;

/// Seconds driven before an event begins, so that it does not show how the simulation was started.
const WARM_UP_S: f64 = 20.0;

/// No generated follower comes closer, m: the protocol leaves events out that come closer than 0.5 m.
const LEAST_SPACING_M: f64 = 0.8;

/// Candidates tried for one event. At least half are accepted, so that finding none never happens.
const CANDIDATES: u64 = 256;

/// A kind of generated traffic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TrafficRegime {
    /// Motorway cruising with mild changes of speed and occasional slowdowns; mean follower speeds of 13.6–25 m/s.
    Fast,
    /// Arterial roads: braking and accelerating in turn, hardly a stop; 8.6–12.4 m/s.
    Middle,
    /// Congestion: stop-and-go waves down to a standstill; 1–7.4 m/s.
    Slow,
}

impl TrafficRegime {
    /// In the order of the protocol, which learns the fast regime first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Middle, Self::Slow];

    /// Its name.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Middle => "middle",
            Self::Slow => "slow",
        }
    }

    /// Least and greatest mean follower speed, m/s. Between the bands lies room, so that 8 and 13 m/s part them cleanly.
    #[must_use]
    pub fn mean_speed_mps(self) -> [f64; 2] {
        match self {
            Self::Fast => [13.6, 25.0],
            Self::Middle => [8.6, 12.4],
            Self::Slow => [1.0, 7.4],
        }
    }
}

/// How long events are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrafficSettings {
    /// Seconds between steps, in (0, 0.2].
    pub dt_s: f64,
    /// Steps of the shortest event, ≥ 2.
    pub min_steps: usize,
    /// Steps of the longest event, ≥ `min_steps`.
    pub max_steps: usize,
}

impl Default for TrafficSettings {
    fn default() -> Self {
        Self { dt_s: 0.1, min_steps: 150, max_steps: 200 }
    }
}

/// An event with its provenance.
#[derive(Debug, Clone, PartialEq)]
pub struct GeneratedEvent {
    /// Unique per (regime, seed, index), such as `fast-42-0007`.
    pub event_id: String,
    /// Always `generated`.
    pub source: String,
    /// The drive that the event is the whole of: one driver behind one leader, so no two events share a run.
    pub run: String,
    /// The trajectory.
    pub event: Event,
}

/// The first `events` events of this regime and seed.
///
/// Every event obeys the project's integrator (`v' = v + dt·a`, spacing by the trapezoid rule) to f32 accuracy;
/// speeds are ≥ 0, spacing is ≥ 0.8 m, accelerations stay within 8 m/s² and the mean follower speed in the regime's band.
///
/// # Panics
/// When a setting is outside its range.
#[must_use]
pub fn generate(regime: TrafficRegime, seed: u64, events: usize, settings: &TrafficSettings) -> Vec<GeneratedEvent> {
    assert!(settings.dt_s > 0.0 && settings.dt_s <= 0.2, "a step is in (0, 0.2] s");
    assert!(2 <= settings.min_steps && settings.min_steps <= settings.max_steps, "an event has from min to max steps");
    (0..events)
        .map(|index| {
            let name = format!("{}-{seed}-{index:04}", regime.as_str());
            GeneratedEvent {
                run: format!("drive-{name}"),
                event_id: name,
                source: "generated".to_owned(),
                event: accepted(regime, seed, index as u64, settings),
            }
        })
        .collect()
}

/// The first plausible candidate of this index.
fn accepted(regime: TrafficRegime, seed: u64, index: u64, settings: &TrafficSettings) -> Event {
    (0..CANDIDATES)
        .map(|attempt| {
            let key = [seed, regime as u64, index, attempt];
            candidate(regime, &mut Noise::keyed(key), settings)
        })
        .find(|event| is_plausible(event, regime, settings.min_steps))
        .expect("a good part of the candidates is plausible")
}

fn candidate(regime: TrafficRegime, noise: &mut Noise, settings: &TrafficSettings) -> Event {
    let dt_s = settings.dt_s;
    let steps = noise.whole(settings.min_steps, settings.max_steps);
    let mut warm_up = 0;
    while warm_up as f64 * dt_s < WARM_UP_S {
        warm_up += 1;
    }
    let leader_mps = leader_speeds(regime, warm_up + steps, dt_s, noise);
    let driven = Follower::drawn(regime, noise).behind(&leader_mps, dt_s, noise);
    let stored = |values: &[f64]| values[warm_up..].iter().map(|&x| x as f32).collect();
    Event::new(dt_s, stored(&driven.spacing_m), stored(&driven.speed_mps), stored(&leader_mps))
}

/// Whether nobody comes too close, and the mean speed is in the band over all steps and over the first `min_steps`,
/// to which a protocol with events of equal length cuts them.
fn is_plausible(event: &Event, regime: TrafficRegime, min_steps: usize) -> bool {
    let [low, high] = regime.mean_speed_mps();
    let close = event.spacing_m().iter().any(|&s| f64::from(s) < LEAST_SPACING_M);
    let cut: f64 = event.follower_speed_mps()[..min_steps].iter().map(|&v| f64::from(v)).sum();
    !close && [event.mean_speed_mps(), cut / min_steps as f64].iter().all(|mean| (low..=high).contains(mean))
}

#[cfg(test)]
mod tests;
