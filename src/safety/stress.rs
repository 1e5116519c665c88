//! Scenarios meant to be hard: leaders that brake in every way, and cars that cut in.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;

use super::{HARDEST_BRAKING_MPS2, Trajectory};
use crate::car_following::Event;

/// How long the drive goes on after the leader has done its worst, s.
const AFTERMATH_S: f64 = 4.0;

/// What a leader does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StressClass {
    /// It brakes at 1 to 8 m/s² to standstill, from every speed, at every headway, closing or opening.
    Braking,
    /// It brakes, goes on, and brakes harder.
    BrakeAndGo,
    /// It stops, stands, goes and stops again, up to three times.
    StopAndGo,
    /// Another car cuts in at the last step of the window, decimetres to metres ahead, and may brake itself.
    CutIn,
}

impl StressClass {
    /// In the order of the set.
    pub const ALL: [Self; 4] = [Self::Braking, Self::BrakeAndGo, Self::StopAndGo, Self::CutIn];

    /// Its name.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Braking => "braking",
            Self::BrakeAndGo => "brake_and_go",
            Self::StopAndGo => "stop_and_go",
            Self::CutIn => "cut_in",
        }
    }
}

/// What a stress set is made for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StressSettings {
    /// Seconds between steps.
    pub dt_s: f64,
    /// Steps of the window that is given, ≥ 2.
    pub horizon: usize,
    /// Scenarios of each class.
    pub per_class: usize,
    /// Of every random choice.
    pub seed: u64,
}

impl StressSettings {
    /// The set that is published: 192 scenarios of each class, seed 42.
    #[must_use]
    pub fn published(dt_s: f64, horizon: usize) -> Self {
        Self { dt_s, horizon, per_class: 192, seed: 42 }
    }
}

/// A scenario. Its event's first `horizon` steps are the window: a follower at constant speed behind its leader.
#[derive(Debug, Clone, PartialEq)]
pub struct StressScenario {
    /// What the leader does.
    pub class: StressClass,
    /// The leader over all steps. From step `horizon` on its follower is the reference: it goes on as the window did until
    /// one step after the leader first brakes (or the other car cuts in), then brakes at 8 m/s² to standstill.
    pub event: Event,
    /// Whether that reference follower does not collide: then nobody may.
    pub avoidable: bool,
}

/// The scenarios of these settings, longest first. A pure function of them.
#[must_use]
pub fn stress_set(settings: &StressSettings) -> Vec<StressScenario> {
    let of_class = |class: StressClass| (0..settings.per_class).map(move |index| scenario(class, index, settings));
    let mut set: Vec<_> = StressClass::ALL.into_iter().flat_map(of_class).collect();
    set.sort_by_key(|scenario| std::cmp::Reverse(scenario.event.steps()));
    set
}

/// Uniform random numbers of one scenario.
struct Draw(ChaCha8Rng);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64)
    }

    /// Uniform in the logarithm.
    fn around(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.between(0.0, 1.0))
    }

    fn whole(&mut self, low: u32, high: u32) -> u32 {
        low + (self.0.next_u64() % u64::from(high - low + 1)) as u32
    }
}

/// A leader's speeds, step by step.
struct Leader {
    dt_s: f64,
    speed_mps: Vec<f64>,
}

impl Leader {
    fn now(&self) -> f64 {
        *self.speed_mps.last().expect("a leader has a speed from the start")
    }

    /// Changes speed at this rate until `speed`, never below 0.
    fn to(&mut self, accel_mps2: f64, speed: f64) {
        while (speed - self.now()) * accel_mps2.signum() > 0.0 {
            let next = self.now() + accel_mps2 * self.dt_s;
            self.speed_mps.push(if accel_mps2 < 0.0 { next.max(speed) } else { next.min(speed) });
        }
    }

    fn stay(&mut self, seconds: f64) {
        let steps = (seconds / self.dt_s).round() as usize;
        self.speed_mps.extend(vec![self.now(); steps]);
    }
}

fn scenario(class: StressClass, index: usize, settings: &StressSettings) -> StressScenario {
    let mut seed = [0; 32];
    for (bytes, word) in seed.chunks_exact_mut(8).zip([settings.seed, class as u64, index as u64, 0x5afe]) {
        bytes.copy_from_slice(&word.to_le_bytes());
    }
    let draw = &mut Draw(ChaCha8Rng::from_seed(seed));
    // Strata, so that a small set covers the braking rates too.
    let braking_mps2 = (index % 8 + 1) as f64;
    let dt_s = settings.dt_s;
    let follower = if class == StressClass::StopAndGo { draw.between(2.0, 14.0) } else { draw.between(3.0, 36.0) };
    let spacing = 1.0 + draw.around(0.25, 2.5) * follower;
    let window_s = dt_s * settings.horizon as f64;
    // Closing or opening slowly, never from nearer than half a metre.
    let closing = draw.between(-2.0, 3.0).max((0.5 - spacing) / window_s).min(follower);
    let mut leader = Leader { dt_s, speed_mps: vec![follower - closing; settings.horizon] };
    let left = |t: usize| (settings.horizon - 1 - t) as f64;
    let mut spacings: Vec<f64> = (0..settings.horizon).map(|t| spacing + closing * dt_s * left(t)).collect();
    if class == StressClass::CutIn {
        leader.speed_mps[settings.horizon - 1] = (follower - draw.between(-4.0, 6.0)).max(0.0);
        spacings[settings.horizon - 1] = draw.around(0.2, 12.0).min(spacing);
    }
    act(class, braking_mps2, &mut leader, draw);
    leader.stay(AFTERMATH_S);
    finish(class, settings.horizon, follower, &spacings, leader)
}

/// What the leader does after the window.
fn act(class: StressClass, braking_mps2: f64, leader: &mut Leader, draw: &mut Draw) {
    match class {
        StressClass::Braking => {
            leader.stay(draw.between(0.0, 1.0));
            leader.to(-braking_mps2, 0.0);
        }
        StressClass::BrakeAndGo => {
            let cruise = leader.now();
            leader.to(-braking_mps2, cruise * draw.between(0.2, 0.8));
            leader.stay(draw.between(0.0, 2.0));
            leader.to(draw.between(1.0, 2.5), cruise * draw.between(0.8, 1.0));
            leader.to(-draw.between(braking_mps2, HARDEST_BRAKING_MPS2), cruise * draw.between(0.0, 0.3));
        }
        StressClass::StopAndGo => {
            for _ in 0..draw.whole(1, 3) {
                leader.to(-braking_mps2, 0.0);
                leader.stay(draw.between(0.5, 4.0));
                leader.to(draw.between(0.8, 2.5), draw.between(2.0, 10.0));
            }
            leader.to(-draw.between(braking_mps2, HARDEST_BRAKING_MPS2), 0.0);
        }
        StressClass::CutIn => {
            // One in four does not brake; the others do at once or within two seconds, half of them to standstill.
            if draw.whole(0, 3) > 0 {
                leader.stay(draw.between(0.0, 2.0));
                let rest = leader.now() * draw.between(-0.5, 0.5).max(0.0);
                leader.to(-braking_mps2, rest);
            }
        }
    }
}

/// Lets the reference follower drive, and says whether it could.
fn finish(class: StressClass, horizon: usize, follower: f64, spacings: &[f64], leader: Leader) -> StressScenario {
    let Leader { dt_s, speed_mps } = leader;
    let steps = speed_mps.len();
    let narrow = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<_>>();
    let mut window_spacing = narrow(spacings);
    window_spacing.resize(steps, 0.0);
    let event = Event::new(dt_s, window_spacing, vec![follower as f32; steps], narrow(&speed_mps));
    let begins = if class == StressClass::CutIn {
        horizon - 1
    } else {
        (horizon..steps).find(|&t| speed_mps[t] < speed_mps[t - 1]).unwrap_or(steps) - 1
    };
    let reference =
        Trajectory::by_rule(&event, horizon, |t, _, _, _| if t > begins { -HARDEST_BRAKING_MPS2 } else { 0.0 });
    let avoidable = !reference.collides(horizon);
    let event = Event::new(dt_s, reference.spacing_m, reference.follower_speed_mps, event.leader_speed_mps().to_vec());
    StressScenario { class, event, avoidable }
}

#[cfg(test)]
#[path = "stress_tests.rs"]
mod tests;
