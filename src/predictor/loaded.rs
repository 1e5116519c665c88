//! One version, loaded and ready to answer.

use std::cell::RefCell;
use std::ops::Range;

use rayon::ThreadPool;

use super::{Flag, PredictError, Prediction, Simulated};
use crate::car_following::Event;
use crate::driver::{Driver, DriverBuffers, Scaling, Seen, Window};
use crate::evaluation::{self, Errors, ServedErrors};
use crate::safety::Envelope;
use crate::store::{Store, StoreError};

/// An input counts as out of range when it lies beyond the least or greatest value seen in training by more than this
/// share of the range between them: recordings end somewhere, and a hair beyond the end is not another kind of traffic.
const RANGE_MARGIN: f32 = 0.05;

thread_local! {
    /// What a thread that predicts keeps from one request to the next, for whichever version, and the network's accelerations.
    static BUFFERS: RefCell<(DriverBuffers, Vec<f32>)> = RefCell::default();
}

/// A version ready to answer. Fixed for ever.
#[derive(Debug)]
pub struct Loaded {
    version: i64,
    pub(super) driver: Driver,
    /// What bounds the network's accelerations; none when the version's settings say so.
    envelope: Option<Envelope>,
}

impl Loaded {
    /// Loads a version: its own settings and scaling, and weights whose digest is right.
    pub(super) async fn load(store: &Store, model_id: i64, version: i64) -> Result<Self, PredictError> {
        let unusable = |error: &dyn std::fmt::Display| {
            tracing::error!(model_id, version, %error, "a version cannot be loaded");
            store.note_corrupt(model_id, version, error.to_string());
            PredictError::Unusable(version)
        };
        let found = store.version(model_id, version).await.map_err(|error| told(error, unusable))?;
        let found = found.ok_or(PredictError::UnknownVersion(version))?;
        if found.pruned {
            return Err(PredictError::Pruned(version));
        }
        if let Some(corrupt) = found.corrupt {
            return Err(unusable(&corrupt));
        }
        let scaling: Scaling = serde_json::from_value(found.scaling).map_err(|e| unusable(&e))?;
        let weights = store.weights(model_id, version).await.map_err(|error| told(error, unusable))?;
        if !weights.iter().all(|weight| weight.is_finite()) {
            return Err(unusable(&"a weight is not finite"));
        }
        let driver = Driver::new(found.settings.shape(), scaling, weights);
        let driver = driver.ok_or_else(|| unusable(&"the number of weights does not fit the shape"))?;
        let envelope = found.settings.envelope.then(|| Envelope::new(driver.shape().dt_s));
        Ok(Self { version, driver, envelope })
    }

    /// Its number.
    #[must_use]
    pub fn version(&self) -> i64 {
        self.version
    }

    /// Steps in a window.
    #[must_use]
    pub fn horizon(&self) -> usize {
        self.driver.shape().horizon
    }

    /// One answer a window, on this thread. Of memory it takes the answers' alone.
    ///
    /// # Errors
    /// When a window does not hold exactly the last `horizon` steps of finite values.
    pub fn predict(&self, windows: &[Window]) -> Result<Vec<Prediction>, PredictError> {
        self.predict_some(windows, 0..windows.len())
    }

    /// [`Self::predict`] for some of the windows of a request.
    pub(super) fn predict_some(&self, windows: &[Window], some: Range<usize>) -> Result<Vec<Prediction>, PredictError> {
        self.check(windows, some.clone())?;
        let windows = &windows[some];
        BUFFERS.with_borrow_mut(|(buffers, raw)| {
            raw.clear();
            raw.resize(windows.len(), 0.0);
            self.driver.accelerations_into(windows, buffers, raw);
            let answer = |(window, &raw_mps2): (&Window, &f32)| {
                let out_of_range = (0..self.horizon()).any(|t| out_of_range(self.driver.scaling(), window.seen(t)));
                self.answer(raw_mps2, window.seen(self.horizon() - 1), &[(out_of_range, Flag::OutOfRange)])
            };
            Ok(windows.iter().zip(&*raw).map(answer).collect())
        })
    }

    /// The answer where the network asks for `raw_mps2` at the step `now`: the envelope adds its flag to those given.
    pub(super) fn answer(&self, raw_mps2: f32, now: Seen, given: &[(bool, Flag)]) -> Prediction {
        let Seen { spacing_m, follower_speed_mps, leader_speed_mps } = now;
        let served =
            |envelope: Envelope| envelope.served_mps2(raw_mps2, spacing_m, follower_speed_mps, leader_speed_mps);
        let accel_mps2 = self.envelope.map_or(raw_mps2, served);
        let flags = flags(given.iter().copied().chain([(accel_mps2 != raw_mps2, Flag::Envelope)]));
        Prediction { accel_mps2, raw_accel_mps2: raw_mps2, flags }
    }

    /// Drives a follower on from `initial` behind a leader, on this thread. `leader_speed_mps[0]` is the step after it.
    ///
    /// # Errors
    /// When the window does not hold exactly the last `horizon` steps, or a value is not finite.
    pub fn simulate(&self, initial: &Window, leader_speed_mps: &[f32]) -> Result<Simulated, PredictError> {
        self.check(std::slice::from_ref(initial), 0..1)?;
        finite(0, "leader_speed_mps", leader_speed_mps)?;
        let drive = self.driver.simulate(initial, leader_speed_mps, self.envelope);
        let driven = Window {
            follower_speed_mps: drive.follower_speed_mps,
            leader_speed_mps: leader_speed_mps.to_vec(),
            spacing_m: drive.spacing_m,
        };
        let strange =
            |part: &Window| (0..part.spacing_m.len()).any(|t| out_of_range(self.driver.scaling(), part.seen(t)));
        let out_of_range = strange(initial) || strange(&driven);
        Ok(Simulated {
            collided: driven.spacing_m.iter().any(|&spacing| spacing <= 0.0),
            spacing_m: driven.spacing_m,
            follower_speed_mps: driven.follower_speed_mps,
            accel_mps2: drive.accel_mps2,
            flags: flags([(out_of_range, Flag::OutOfRange), (drive.differing_steps > 0, Flag::Envelope)]),
        })
    }

    /// The event as the version drives it, within the envelope, behind the recorded leader: the window that it begins from is as
    /// recorded. It must be longer than that, and at the version's step.
    pub(super) fn driven(&self, event: &Event) -> Event {
        let (begin, leader) = (0..self.horizon(), event.leader_speed_mps());
        let initial = Window {
            follower_speed_mps: event.follower_speed_mps()[begin.clone()].to_vec(),
            leader_speed_mps: leader[begin.clone()].to_vec(),
            spacing_m: event.spacing_m()[begin].to_vec(),
        };
        let drive = self.driver.simulate(&initial, &leader[self.horizon()..], self.envelope);
        let joined = |before: Vec<f32>, after: Vec<f32>| [before, after].concat();
        Event::new(
            event.dt_s(),
            joined(initial.spacing_m, drive.spacing_m),
            joined(initial.follower_speed_mps, drive.follower_speed_mps),
            leader.to_vec(),
        )
    }

    /// Drives `events`, at the version's step, closed loop.
    pub(super) fn evaluate(&self, events: &[Event], workers: &ThreadPool) -> Errors {
        let driver = &self.driver;
        evaluation::evaluate(driver.shape(), driver.scaling(), driver.weights(), events, workers)
    }

    /// As [`Self::evaluate`], of what is served; none when that is the network's own.
    pub(super) fn evaluate_served(&self, events: &[Event], workers: &ThreadPool) -> Option<ServedErrors> {
        let driver = &self.driver;
        let served =
            || evaluation::evaluate_served(driver.shape(), driver.scaling(), driver.weights(), events, workers);
        self.envelope.is_some().then(served)
    }

    fn check(&self, windows: &[Window], some: Range<usize>) -> Result<(), PredictError> {
        let horizon = self.horizon();
        for index in some {
            let window = &windows[index];
            for (member, values) in [
                ("follower_speed_mps", &window.follower_speed_mps),
                ("leader_speed_mps", &window.leader_speed_mps),
                ("spacing_m", &window.spacing_m),
            ] {
                if values.len() != horizon {
                    return Err(PredictError::WindowLength { window: index, member, found: values.len(), horizon });
                }
                finite(index, member, values)?;
            }
        }
        Ok(())
    }
}

/// What cannot be read because it is not what was written is unusable; a database that is busy or gone is another matter.
fn told(error: StoreError, unusable: impl FnOnce(&dyn std::fmt::Display) -> PredictError) -> PredictError {
    match error {
        StoreError::Malformed { .. } | StoreError::Corrupt { .. } | StoreError::Damaged(_) => unusable(&error),
        error => error.into(),
    }
}

pub(super) fn finite(window: usize, member: &'static str, values: &[f32]) -> Result<(), PredictError> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(step) => Err(PredictError::NotFinite { window, member, step }),
        None => Ok(()),
    }
}

fn flags(flags: impl IntoIterator<Item = (bool, Flag)>) -> Vec<Flag> {
    let mut flags: Vec<Flag> = flags.into_iter().filter_map(|(holds, flag)| holds.then_some(flag)).collect();
    flags.sort_unstable();
    flags
}

/// Whether some input of a step lies outside what training saw, give or take [`RANGE_MARGIN`].
pub(super) fn out_of_range(scaling: &Scaling, seen: Seen) -> bool {
    let outside = |input: usize, value: f32| {
        let (low, high) = (scaling.low[input], scaling.high[input]);
        let margin = RANGE_MARGIN * (high - low);
        value < low - margin || value > high + margin
    };
    let Seen { follower_speed_mps: follower, leader_speed_mps: leader, spacing_m } = seen;
    outside(0, follower) || outside(1, leader) || outside(2, leader - follower) || outside(3, spacing_m)
}
