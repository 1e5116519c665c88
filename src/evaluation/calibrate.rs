//! Reference drivers fitted to events.

use std::cell::RefCell;

use argmin::core::{CostFunction, Error, Executor};
use argmin::solver::neldermead::NelderMead;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::ThreadPool;
use serde::{Deserialize, Serialize};

use super::Errors;
use super::reference::drive_reference;
use crate::car_following::Event;
use crate::reference::{ReferenceDriver, ReferenceKind};

/// How long and on how much a reference driver is calibrated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationSettings {
    /// Sets of parameters tried; each drives all the events.
    pub evaluations: u32,
    /// Events looked at, those of least digest.
    pub max_events: usize,
    /// Steps of all of them together; more events than fit are left out too.
    pub max_steps: usize,
    /// Weight of mean relu(−s) beside mean (s − s*)², as in training.
    pub collision_penalty: f64,
    /// Chooses the places the search starts from.
    pub seed: u64,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self { evaluations: 2400, max_events: 1000, max_steps: 300_000, collision_penalty: 1000.0, seed: 42 }
    }
}

/// A reference driver and what it was fitted to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// With the parameters found; the published ones when there was no event to fit them to.
    pub driver: ReferenceDriver,
    /// Its errors on the events it was fitted to.
    pub on: Errors,
    /// Sets of parameters tried.
    pub evaluations: u32,
}

/// Of the evaluations, this share goes to places spread over the bounds, to find where to start.
const SPREAD_SHARE: f64 = 0.15;
/// Descents from the best of these places, with simplices of this size: the objective has several valleys.
const DESCENTS: usize = 5;
const WIDE: f64 = 0.25;
/// The last descent, from the best place of all, begins with a smaller one.
const NARROW: f64 = 0.1;
/// A descent ends when its simplex is as flat as this share of the objective.
const FLAT: f64 = 1e-5;

/// Fits the parameters of `kind` within their bounds ([`ReferenceKind::parameters`]) to `events`, driven closed loop from step
/// `horizon` on: they minimise `mean (s − s*)² + collision_penalty · mean relu(−s)`, the means pooled over simulated steps.
///
/// Places spread over the bounds are tried first, the published parameters before any other, then Nelder and Mead's simplex
/// descends from the best few of them, and once more from the best place of all. Outside the bounds the objective is mirrored, so that every place has
/// parameters within them. The result is never worse than the published parameters, does not depend on the order of
/// `events`, and has the same bits for any number of threads. Events no longer than the horizon are left out.
#[must_use]
pub fn calibrate(
    kind: ReferenceKind,
    horizon: usize,
    events: &[&Event],
    settings: &CalibrationSettings,
    workers: &ThreadPool,
) -> Calibration {
    let chosen = chosen(events, horizon, settings);
    let search = Search { kind, horizon, events: &chosen, settings, workers, found: RefCell::default() };
    search.run();
    let Found { best, evaluations, .. } = search.found.into_inner();
    let driver = match (best, chosen.first()) {
        (Some(best), Some(event)) => best.driver.in_steps_of(event.dt_s()),
        _ => kind.published(),
    };
    Calibration { driver, on: drive_reference(&driver, horizon, &chosen, workers).errors, evaluations }
}

/// The events of least digest, in that order, as many as the settings take.
fn chosen<'a>(events: &[&'a Event], horizon: usize, settings: &CalibrationSettings) -> Vec<&'a Event> {
    let mut sorted: Vec<_> =
        events.iter().filter(|event| event.steps() > horizon).map(|event| (event.content_sha256(), *event)).collect();
    sorted.sort_by_key(|(digest, _)| *digest);
    let mut steps = 0;
    let within = |event: &&Event| {
        steps += event.steps();
        steps <= settings.max_steps
    };
    sorted.into_iter().map(|(_, event)| event).take(settings.max_events).take_while(within).collect()
}

/// A set of parameters that was tried.
#[derive(Debug, Clone)]
struct Tried {
    place: Vec<f64>,
    objective: f64,
    driver: ReferenceDriver,
}

#[derive(Debug, Default)]
struct Found {
    /// The place with the least objective so far.
    best: Option<Tried>,
    evaluations: u32,
}

/// A search over places: the logarithm of a parameter from its low to its high bound is a coordinate from 0 to 1. Parameters
/// are scales, and what is plausible of them spans more than a power of ten.
struct Search<'a> {
    kind: ReferenceKind,
    horizon: usize,
    events: &'a [&'a Event],
    settings: &'a CalibrationSettings,
    workers: &'a ThreadPool,
    found: RefCell<Found>,
}

impl Search<'_> {
    fn run(&self) {
        if self.events.is_empty() || self.kind.parameters().is_empty() {
            return;
        }
        let mut starts = vec![self.try_out(&self.place_of(&self.kind.published()))];
        let mut random = ChaCha8Rng::seed_from_u64(self.settings.seed);
        for _ in 1..(f64::from(self.settings.evaluations) * SPREAD_SHARE) as u32 {
            let place: Vec<f64> = self.kind.parameters().iter().map(|_| unit(&mut random)).collect();
            starts.push(self.try_out(&place));
        }
        starts.sort_by(|a, b| a.objective.total_cmp(&b.objective));
        starts.truncate(DESCENTS);
        for (descents_before, start) in starts.iter().enumerate() {
            self.descend(start, WIDE, self.left() / (DESCENTS + 1 - descents_before) as u32);
        }
        let best = self.found.borrow().best.clone();
        if let Some(best) = best {
            self.descend(&best, NARROW, self.left());
        }
    }

    fn left(&self) -> u32 {
        self.settings.evaluations.saturating_sub(self.found.borrow().evaluations)
    }

    /// Descends from a place with a simplex of this size and at most so many evaluations.
    fn descend(&self, start: &Tried, size: f64, evaluations: u32) {
        let mut simplex = vec![start.place.clone()];
        for axis in 0..start.place.len() {
            let mut corner = start.place.clone();
            corner[axis] += if corner[axis] < 0.5 { size } else { -size };
            simplex.push(corner);
        }
        let until = self.found.borrow().evaluations + evaluations;
        let solver = NelderMead::new(simplex)
            .with_sd_tolerance(FLAT * start.objective.abs().max(f64::MIN_POSITIVE))
            .expect("a tolerance is not below 0");
        Executor::new(Descent { search: self, until }, solver)
            .configure(|state| state.max_iters(evaluations.into()))
            .run()
            .expect("neither the objective nor the simplex fails");
    }

    /// Drives with the parameters of a place, which is remembered when it is the best.
    fn try_out(&self, place: &[f64]) -> Tried {
        let driver = self.driver_at(place);
        let driven = drive_reference(&driver, self.horizon, self.events, self.workers);
        let steps = driven.errors.steps as f64;
        let objective = driven.errors.spacing_sq / steps + self.settings.collision_penalty * driven.intrusion_m / steps;
        let tried = Tried { place: place.to_vec(), objective, driver };
        let mut found = self.found.borrow_mut();
        found.evaluations += 1;
        if found.best.as_ref().is_none_or(|best| objective < best.objective) {
            found.best = Some(tried.clone());
        }
        tried
    }

    fn driver_at(&self, place: &[f64]) -> ReferenceDriver {
        let values: Vec<f64> = self
            .kind
            .parameters()
            .iter()
            .zip(place)
            .map(|(parameter, &x)| {
                let value = parameter.low * (parameter.high / parameter.low).powf(mirrored(x));
                value.clamp(parameter.low, parameter.high)
            })
            .collect();
        self.kind.with(&values)
    }

    fn place_of(&self, driver: &ReferenceDriver) -> Vec<f64> {
        let places = self.kind.parameters().iter().zip(driver.values());
        places.map(|(parameter, value)| (value / parameter.low).ln() / (parameter.high / parameter.low).ln()).collect()
    }
}

/// A descent as the optimiser sees it. Its evaluations over, every place is as bad as can be, and the iterations that are
/// left cost nothing.
struct Descent<'a> {
    search: &'a Search<'a>,
    until: u32,
}

impl CostFunction for Descent<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, place: &Vec<f64>) -> Result<f64, Error> {
        let over = self.search.found.borrow().evaluations >= self.until;
        Ok(if over { f64::INFINITY } else { self.search.try_out(place).objective })
    }
}

/// x mirrored at 0 and 1 as often as needed to lie between them.
fn mirrored(x: f64) -> f64 {
    let turn = x.rem_euclid(2.0);
    if turn <= 1.0 { turn } else { 2.0 - turn }
}

/// Uniform in [0, 1).
fn unit(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
#[path = "calibrate_tests.rs"]
mod tests;
