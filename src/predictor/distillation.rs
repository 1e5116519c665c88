//! A version as drivers of the IDM, one a regime: what simulators without a network can drive.

use rayon::ThreadPool;
use rayon::prelude::*;

use super::{Loaded, PredictError, Predictor, TrialSettings};
use crate::car_following::{Event, Idm};
use crate::evaluation::{calibrate, evaluate_reference};
use crate::lineage::{Model, RegimeName, TestMeasures};
use crate::reference::{ReferenceDriver, ReferenceKind};

/// Of so many events one is held back, to measure on.
const HELD_SHARE: usize = 4;

/// A version, and the events of every regime that it learned and that are still there.
#[derive(Debug)]
pub struct Distillation {
    loaded: Loaded,
    regimes: Vec<(RegimeName, Vec<Event>)>,
    dt_s: f64,
}

/// The IDM that drives most as a version does, in one regime.
#[derive(Debug, Clone, PartialEq)]
pub struct Distilled {
    /// The regime.
    pub regime: RegimeName,
    /// Its parameters.
    pub idm: Idm,
    /// Events that it was fitted to, driven by the version.
    pub fitted_events: u32,
    /// How far it is from the version, on events that were held back: behind the same leaders, from the same beginnings.
    pub from_version: Option<TestMeasures>,
    /// How far it is from what was recorded on these.
    pub from_recorded: Option<TestMeasures>,
    /// And how far the version is from that, as it is served.
    pub version_from_recorded: Option<TestMeasures>,
}

impl Predictor {
    /// Loads a version and training events of every regime that its line learned, as many as calibration takes.
    ///
    /// # Errors
    /// When there is no such version, or it cannot be loaded.
    pub async fn distillation(
        &self,
        model: &Model,
        version: i64,
        settings: &TrialSettings,
    ) -> Result<Distillation, PredictError> {
        let loaded = Loaded::load(&self.store, model.model_id, version).await?;
        let limit = u32::try_from(settings.calibration.max_events).unwrap_or(u32::MAX);
        let mut regimes = Vec::new();
        for learned in self.store.evaluation(model.model_id, version).await? {
            let stored = self.store.line_sample(model.model_id, version, Some(&learned.regime), limit).await?;
            regimes.push((learned.regime, stored.into_iter().map(|stored| stored.event).collect()));
        }
        Ok(Distillation { loaded, regimes, dt_s: model.settings.dt_s })
    }
}

impl Distillation {
    /// Fits a driver for each regime of which there are events to how the version drives behind their leaders. The same bits for
    /// any number of threads.
    #[must_use]
    pub fn distil(self, settings: &TrialSettings, workers: &ThreadPool) -> Vec<Distilled> {
        let Self { loaded, regimes, dt_s } = self;
        let horizon = loaded.horizon();
        let long_enough = |event: Event| Some(event.resample(dt_s)).filter(|event| event.steps() > horizon);
        let with_events = regimes
            .into_iter()
            .map(|(regime, events)| (regime, events.into_iter().filter_map(long_enough).collect::<Vec<_>>()));
        let distil = |(regime, recorded): (RegimeName, Vec<Event>)| {
            let driven: Vec<Event> =
                workers.install(|| recorded.par_iter().map(|event| loaded.driven(event)).collect());
            distilled(regime, &loaded, &recorded, &driven, settings, workers)
        };
        with_events.filter(|(_, events)| !events.is_empty()).map(distil).collect()
    }
}

fn distilled(
    regime: RegimeName,
    loaded: &Loaded,
    recorded: &[Event],
    driven: &[Event],
    settings: &TrialSettings,
    workers: &ThreadPool,
) -> Distilled {
    let horizon = loaded.horizon();
    let is_held = |at: usize| at % HELD_SHARE == HELD_SHARE - 1;
    let fitted: Vec<&Event> = (0..driven.len()).filter(|&at| !is_held(at)).map(|at| &driven[at]).collect();
    let held = |events: &[Event]| -> Vec<Event> {
        (0..events.len()).filter(|&at| is_held(at)).map(|at| events[at].clone()).collect()
    };
    let (held_recorded, held_driven) = (held(recorded), held(driven));
    let calibration = calibrate(ReferenceKind::Idm, horizon, &fitted, &settings.calibration, workers);
    let driver = calibration.driver;
    let ReferenceDriver::Idm(idm) = driver else { unreachable!("an IDM was to be fitted") };
    let from = |events: &[Event]| TestMeasures::of(&evaluate_reference(&driver, horizon, events, workers));
    Distilled {
        regime,
        idm,
        fitted_events: calibration.on.events,
        from_version: from(&held_driven),
        from_recorded: from(&held_recorded),
        version_from_recorded: TestMeasures::of(&match loaded.evaluate_served(&held_recorded, workers) {
            Some(served) => served.errors,
            None => loaded.evaluate(&held_recorded, workers),
        }),
    }
}
