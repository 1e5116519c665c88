//! One version, loaded and ready to answer.

use std::sync::Arc;

use rayon::ThreadPool;

use super::{Flag, PredictError, Prediction, Simulated};
use crate::car_following::Event;
use crate::driver::{Driver, Scaling, Window};
use crate::evaluation::{self, Errors, ServedErrors};
use crate::safety::Envelope;
use crate::store::{Store, StoreError};

/// An input counts as out of range when it lies beyond the least or greatest value seen in training by more than this
/// share of the range between them: recordings end somewhere, and a hair beyond the end is not another kind of traffic.
const RANGE_MARGIN: f32 = 0.05;

/// A version ready to answer. Fixed for ever.
#[derive(Debug)]
pub struct Loaded {
    version: i64,
    driver: Driver,
    /// What bounds the network's accelerations; none when the version's settings say so.
    envelope: Option<Envelope>,
}

impl Loaded {
    /// Loads a version: its own settings and scaling, and weights whose digest is right.
    pub(super) async fn load(store: &Store, model_id: i64, version: i64) -> Result<Self, PredictError> {
        let found = store.version(model_id, version).await?.ok_or(PredictError::UnknownVersion(version))?;
        let unusable = |error: &dyn std::fmt::Display| {
            tracing::error!(model_id, version, %error, "a version cannot be loaded");
            PredictError::Unusable(version)
        };
        let scaling: Scaling = serde_json::from_value(found.scaling).map_err(|e| unusable(&e))?;
        let weights = match store.weights(model_id, version).await {
            Err(error @ StoreError::Malformed { .. }) => return Err(unusable(&error)),
            read => read?,
        };
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

    /// One answer a window, on this thread.
    ///
    /// # Errors
    /// When a window does not hold exactly the last `horizon` steps of finite values.
    pub fn predict(&self, windows: &[Window]) -> Result<Vec<Prediction>, PredictError> {
        self.check(windows)?;
        let accelerations = self.driver.accelerations(windows);
        let answer = |(window, raw_accel_mps2): (&Window, f32)| {
            let accel_mps2 = self.served(window, raw_accel_mps2);
            let flags = flags(out_of_range(self.driver.scaling(), window), accel_mps2 != raw_accel_mps2);
            Prediction { accel_mps2, raw_accel_mps2, flags }
        };
        Ok(windows.iter().zip(accelerations).map(answer).collect())
    }

    /// What is served where the network asks for `raw_mps2` after this window: its last step decides.
    fn served(&self, window: &Window, raw_mps2: f32) -> f32 {
        let now = self.horizon() - 1;
        let (spacing, follower, leader) =
            (window.spacing_m[now], window.follower_speed_mps[now], window.leader_speed_mps[now]);
        self.envelope.map_or(raw_mps2, |envelope| envelope.served_mps2(raw_mps2, spacing, follower, leader))
    }

    /// Drives a follower on from `initial` behind a leader, on this thread. `leader_speed_mps[0]` is the step after it.
    ///
    /// # Errors
    /// When the window does not hold exactly the last `horizon` steps, or a value is not finite.
    pub fn simulate(&self, initial: &Window, leader_speed_mps: &[f32]) -> Result<Simulated, PredictError> {
        self.check(std::slice::from_ref(initial))?;
        finite(0, "leader_speed_mps", leader_speed_mps)?;
        let drive = self.driver.simulate(initial, leader_speed_mps, self.envelope);
        let driven = Window {
            follower_speed_mps: drive.follower_speed_mps,
            leader_speed_mps: leader_speed_mps.to_vec(),
            spacing_m: drive.spacing_m,
        };
        let scaling = self.driver.scaling();
        let out_of_range = out_of_range(scaling, initial) || out_of_range(scaling, &driven);
        Ok(Simulated {
            collided: driven.spacing_m.iter().any(|&spacing| spacing <= 0.0),
            spacing_m: driven.spacing_m,
            follower_speed_mps: driven.follower_speed_mps,
            accel_mps2: drive.accel_mps2,
            flags: flags(out_of_range, drive.differing_steps > 0),
        })
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

    fn check(&self, windows: &[Window]) -> Result<(), PredictError> {
        let horizon = self.horizon();
        for (index, window) in windows.iter().enumerate() {
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

impl super::Predictor {
    /// [`Loaded::predict`], off the async runtime when it is a large request.
    ///
    /// # Errors
    /// As there.
    pub async fn predict(&self, loaded: Arc<Loaded>, windows: Vec<Window>) -> Result<Vec<Prediction>, PredictError> {
        if windows.len() <= self.settings.inline_windows {
            return self.company.predict(loaded, windows).await;
        }
        let answers = tokio::task::spawn_blocking(move || loaded.predict(&windows));
        answers.await.map_err(|_| PredictError::Panicked)?
    }

    /// [`Loaded::simulate`], off the async runtime when it is a long drive.
    ///
    /// # Errors
    /// As there.
    pub async fn simulate(
        &self,
        loaded: Arc<Loaded>,
        initial: Window,
        leader_speed_mps: Vec<f32>,
    ) -> Result<Simulated, PredictError> {
        if leader_speed_mps.len() <= self.settings.inline_windows {
            return loaded.simulate(&initial, &leader_speed_mps);
        }
        let drive = tokio::task::spawn_blocking(move || loaded.simulate(&initial, &leader_speed_mps));
        drive.await.map_err(|_| PredictError::Panicked)?
    }
}

fn finite(window: usize, member: &'static str, values: &[f32]) -> Result<(), PredictError> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(step) => Err(PredictError::NotFinite { window, member, step }),
        None => Ok(()),
    }
}

fn flags(out_of_range: bool, bounded: bool) -> Vec<Flag> {
    let flags = [(out_of_range, Flag::OutOfRange), (bounded, Flag::Envelope)];
    flags.into_iter().filter_map(|(holds, flag)| holds.then_some(flag)).collect()
}

/// Whether some input of some step lies outside what training saw, give or take [`RANGE_MARGIN`].
fn out_of_range(scaling: &Scaling, window: &Window) -> bool {
    let outside = |input: usize, value: f32| {
        let (low, high) = (scaling.low[input], scaling.high[input]);
        let margin = RANGE_MARGIN * (high - low);
        value < low - margin || value > high + margin
    };
    let steps = window.follower_speed_mps.iter().zip(&window.leader_speed_mps).zip(&window.spacing_m);
    steps.into_iter().any(|((&follower, &leader), &spacing)| {
        outside(0, follower) || outside(1, leader) || outside(2, leader - follower) || outside(3, spacing)
    })
}
