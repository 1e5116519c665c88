//! `…/predict` and `…/simulate`: what a version would do.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::{Deserialize, Serialize};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::answer::ok_json;
use super::body::Json;
use super::gate::Need;
use super::numbers::{GREATEST, Numbers};
use super::object::Object;
use super::path::ServedAt;
use super::problem::{Code, InputError, Problem};
use super::table::{self, FIGURES, Form};
use super::versions;
use super::whole::Whole;
use super::{AppState, ServerSettings, figures};
use crate::access::Scope;
use crate::driver::Window;
use crate::predictor::{Loaded, PredictError, Prediction, Simulated};
use crate::telemetry::PredictionKind;

/// Where predictions are asked.
pub(super) const ROUTE: &str = "/v1/models/{model}/predict";
/// Who may ask for them, by whichever way.
pub(super) const NEED: Need = Need::May(Scope::Predict);

/// A window as clients send it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WindowBody {
    follower_speed_mps: Numbers,
    leader_speed_mps: Numbers,
    spacing_m: Numbers,
}

/// The body of a prediction.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PredictBody {
    windows: Vec<Object<WindowBody>>,
    version: Option<Whole>,
}

/// The body of a simulation.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SimulateBody {
    initial: Object<WindowBody>,
    leader_speed_mps: Numbers,
    version: Option<Whole>,
}

#[derive(Debug, Serialize)]
struct Predicted<'a> {
    model: &'a str,
    version: i64,
    predictions: Vec<Prediction>,
}

#[derive(Debug, Serialize)]
struct Simulation<'a> {
    model: &'a str,
    version: i64,
    #[serde(flatten)]
    drive: Simulated,
}

/// Collects what is wrong with the numbers of a request, up to a bound.
struct Defects {
    most: usize,
    found: Vec<InputError>,
}

impl Defects {
    fn add(&mut self, pointer: String, code: &'static str, detail: String) {
        if self.found.len() < self.most {
            self.found.push(InputError::at(pointer, code, detail));
        }
    }

    fn numbers(&mut self, pointer: &str, numbers: &Numbers) {
        for (step, value) in numbers.absurd() {
            let detail = format!("{value:e} is not within ±{GREATEST:e}");
            self.add(format!("{pointer}/{step}"), "out_of_range", detail);
        }
    }

    /// Where it is, is written out only when something is wrong with it.
    fn window(&mut self, pointer: impl Fn() -> String, window: &WindowBody, horizon: usize) {
        for (member, values) in [
            ("follower_speed_mps", &window.follower_speed_mps),
            ("leader_speed_mps", &window.leader_speed_mps),
            ("spacing_m", &window.spacing_m),
        ] {
            let pointer = || format!("{}/{member}", pointer());
            if values.len() != horizon {
                let detail = format!("{} steps; exactly the last {horizon} are needed, oldest first", values.len());
                self.add(pointer(), "window_length", detail);
            } else if !values.absurd().is_empty() {
                self.numbers(&pointer(), values);
            }
        }
    }

    fn refuse(self, what: &'static str) -> Result<(), Problem> {
        if self.found.is_empty() { Ok(()) } else { Err(Code::InvalidBody.because(what).with_errors(self.found)) }
    }
}

impl PredictBody {
    /// Refuses none, or more windows than are taken at once.
    pub(super) fn check_count(&self, settings: &ServerSettings) -> Result<(), Problem> {
        let most = settings.predict_windows_max;
        let found = self.windows.len();
        if (1..=most).contains(&found) { Ok(()) } else { Err(too_many("/windows", found, most)) }
    }

    /// The windows, each of exactly `horizon` steps.
    pub(super) fn windows(self, horizon: usize, settings: &ServerSettings) -> Result<Vec<Window>, Problem> {
        let mut defects = Defects { most: settings.errors_max, found: Vec::new() };
        for (at, Object(window)) in self.windows.iter().enumerate() {
            defects.window(|| format!("/windows/{at}"), window, horizon);
        }
        defects.refuse("a window cannot be read")?;
        Ok(self.windows.into_iter().map(|Object(window)| window.into()).collect())
    }
}

impl SimulateBody {
    /// Refuses no step, or more than are driven at once.
    pub(super) fn check_count(&self, settings: &ServerSettings) -> Result<(), Problem> {
        let most = settings.simulate_steps_max;
        let found = self.leader_speed_mps.len();
        if (1..=most).contains(&found) { Ok(()) } else { Err(too_many("/leader_speed_mps", found, most)) }
    }

    /// The window to start from, of exactly `horizon` steps, and the leader's speeds after it.
    pub(super) fn start(self, horizon: usize, settings: &ServerSettings) -> Result<(Window, Vec<f32>), Problem> {
        let mut defects = Defects { most: settings.errors_max, found: Vec::new() };
        defects.window(|| "/initial".to_owned(), &self.initial.0, horizon);
        defects.numbers("/leader_speed_mps", &self.leader_speed_mps);
        defects.refuse("the simulation cannot begin")?;
        Ok((self.initial.0.into(), self.leader_speed_mps.into_narrowed()))
    }
}

impl From<WindowBody> for Window {
    fn from(body: WindowBody) -> Self {
        Self {
            follower_speed_mps: body.follower_speed_mps.into_narrowed(),
            leader_speed_mps: body.leader_speed_mps.into_narrowed(),
            spacing_m: body.spacing_m.into_narrowed(),
        }
    }
}

fn slot(slots: &Arc<Semaphore>) -> Result<OwnedSemaphorePermit, Problem> {
    Arc::clone(slots).try_acquire_owned().map_err(|_| busy())
}

fn busy() -> Problem {
    Problem::busy(Code::Busy, "as many predictions as the server takes at once are under way")
}

fn too_many(pointer: &str, found: usize, most: usize) -> Problem {
    let detail = format!("{found} given; 1 to {most} are taken at once");
    Code::InvalidBody.because(detail.clone()).with_error(InputError::at(pointer, "out_of_range", detail))
}

/// `POST /v1/models/{model}/predict`
pub(super) async fn predict(
    State(app): State<Arc<AppState>>,
    model: ServedAt,
    headers: HeaderMap,
    Json(body): Json<PredictBody>,
) -> Result<Response, Problem> {
    let form = Form::accepted(&headers, FIGURES);
    let Some(format) = form.sheet() else { return answer(&app, &model, body).await };
    let predicted = predicted(&app, &model, body).await?;
    let name = format!("{}-v{}-predictions", predicted.model, predicted.version);
    table::answer(form, format, &name, &figures::of_predictions(&predicted.predictions))
}

/// The answer to a prediction's body.
///
/// # Errors
/// When it cannot be answered.
pub(super) async fn answer(app: &AppState, model: &ServedAt, body: PredictBody) -> Result<Response, Problem> {
    Ok(ok_json(&predicted(app, model, body).await?))
}

async fn predicted<'m>(app: &AppState, model: &'m ServedAt, body: PredictBody) -> Result<Predicted<'m>, Problem> {
    body.check_count(&app.settings)?;
    let _slot = slot_for(app, body.windows.len())?;
    let loaded = load(app, model, body.version.map(|Whole(version)| version)).await?;
    let windows = body.windows(loaded.horizon(), &app.settings)?;
    let version = loaded.version();
    let predictions = compute(app, model, loaded, windows).await?;
    Ok(Predicted { model: &model.name, version, predictions })
}

/// A turn for a request of so many windows; small ones need none.
///
/// # Errors
/// 503 when as many large ones as may be are under way.
pub(super) fn slot_for(app: &AppState, windows: usize) -> Result<Option<OwnedSemaphorePermit>, Problem> {
    let large = windows > app.predictor.settings().inline_windows;
    large.then(|| slot(&app.prediction_slots)).transpose()
}

/// The version that answers: the named one, else what serves.
///
/// # Errors
/// When there is none, or it cannot be loaded.
pub(super) async fn load(app: &AppState, model: &ServedAt, version: Option<i64>) -> Result<Arc<Loaded>, Problem> {
    app.predictor.version(model.model_id, version).await.map_err(|e| refusal(model, e))
}

/// What a version answers for windows, counted.
///
/// # Errors
/// When too many wait, or it is not finite.
pub(super) async fn compute(
    app: &AppState,
    model: &ServedAt,
    loaded: Arc<Loaded>,
    windows: Vec<Window>,
) -> Result<Vec<Prediction>, Problem> {
    let (version, began) = (loaded.version(), Instant::now());
    let predictions = app.predictor.predict(loaded, windows).await.map_err(|e| refusal(model, e))?;
    check_finite(version, &predictions)?;
    let flags = predictions.iter().map(|prediction| prediction.flags.as_slice());
    app.metrics.predicted(&model.name, version, PredictionKind::Windows, began.elapsed(), flags);
    Ok(predictions)
}

/// # Errors
/// 500 for what no client may see.
pub(super) fn check_finite(version: i64, predictions: &[Prediction]) -> Result<(), Problem> {
    if predictions.iter().any(|p| !p.accel_mps2.is_finite() || !p.raw_accel_mps2.is_finite()) {
        return Err(Problem::internal(format!("version {version} predicts a number that is not finite")));
    }
    Ok(())
}

/// `POST /v1/models/{model}/simulate`
pub(super) async fn simulate(
    State(app): State<Arc<AppState>>,
    model: ServedAt,
    Json(body): Json<SimulateBody>,
) -> Result<Response, Problem> {
    body.check_count(&app.settings)?;
    let _slot = slot(&app.prediction_slots)?;
    let loaded = load(&app, &model, body.version.map(|Whole(version)| version)).await?;
    let (initial, leader_speed_mps) = body.start(loaded.horizon(), &app.settings)?;
    let (version, began) = (loaded.version(), Instant::now());
    let drive = app.predictor.simulate(loaded, initial, leader_speed_mps).await;
    let drive = drive.map_err(|e| refusal(&model, e))?;
    let arrays = [&drive.spacing_m, &drive.follower_speed_mps, &drive.accel_mps2];
    if arrays.into_iter().flatten().any(|value| !value.is_finite()) {
        return Err(Problem::internal(format!("version {version} drives to a number that is not finite")));
    }
    let flags = std::iter::once(drive.flags.as_slice());
    app.metrics.predicted(&model.name, version, PredictionKind::Simulation, began.elapsed(), flags);
    Ok(ok_json(&Simulation { model: &model.name, version, drive }))
}

/// Why nothing is predicted.
pub(super) fn refusal(model: &ServedAt, error: PredictError) -> Problem {
    match error {
        PredictError::NoLiveVersion => Code::NoLiveVersion.because(format!("nothing of {} serves yet", model.name)),
        PredictError::UnknownVersion(version) => versions::missing(&model.name, version),
        PredictError::Busy => busy(),
        PredictError::Unusable(_) => Code::Corrupt.because(error.to_string()),
        PredictError::Pruned(_) => Code::VersionPruned.because(error.to_string()),
        PredictError::Store(error) => error.into(),
        // Windows are checked above, with pointers; what the predictor still refuses is a bug here.
        error => Problem::internal(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bad_window_is_listed_up_to_the_bound() {
        let numbers = |values: &[f64]| serde_json::from_value(serde_json::json!(values)).unwrap();
        let window = |n: usize| WindowBody {
            follower_speed_mps: numbers(&vec![1.0; n]),
            leader_speed_mps: numbers(&[1.0; 2]),
            spacing_m: numbers(&[1.0, -2e6]),
        };
        let mut defects = Defects { most: 3, found: Vec::new() };
        for at in 0..3 {
            defects.window(|| format!("/windows/{at}"), &window(at + 1), 2);
        }
        let places: Vec<_> =
            defects.found.iter().map(|e| serde_json::to_value(e).unwrap()["pointer"].clone()).collect();
        assert_eq!(places, ["/windows/0/follower_speed_mps", "/windows/0/spacing_m/1", "/windows/1/spacing_m/1"]);
        assert!(defects.refuse("why").is_err());
    }
}
