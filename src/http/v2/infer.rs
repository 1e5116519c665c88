//! `…/infer`: windows, or the newest step of a vehicle, in; accelerations out.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::{Request as HttpRequest, State};
use axum::http::HeaderMap;
use axum::response::Response;

use super::super::AppState;
use super::super::body::{Held, read_whole};
use super::super::path::{MaybeVersionAt, ServedAt};
use super::super::predict::{check_finite, compute, load, refusal, slot_for};
use super::super::problem::{Code, InputError, Problem};
use super::outputs::answer;
use super::request::{COLUMNS, Input, Request, Sequence, decompressed, seen, understood};
use super::tensor::wrong;
use crate::driver::Window;
use crate::predictor::{Prediction, SequenceError};
use crate::telemetry::{InferenceTimes, PredictionKind};

/// Longest body that is understood where it arrives, bytes.
const INLINE_BYTES: usize = 64 * 1024;

/// `POST /v2/models/{model}[/versions/{version}]/infer`
pub(in crate::http) async fn infer(
    State(app): State<Arc<AppState>>,
    model: ServedAt,
    MaybeVersionAt(version): MaybeVersionAt,
    request: HttpRequest,
) -> Result<Response, Problem> {
    let (parts, body) = request.into_parts();
    let held = read_whole(&parts.headers, body, &app).await?;
    let began = Instant::now();
    let request = understood_somewhere(&app, parts.headers, held).await?;
    let input = began.elapsed();
    app.unloaded.check(&model)?;
    let (version, answered) = match &request.input {
        Input::Windows { count, horizon, elements } => {
            windows(&app, &model, version, [*count, *horizon], elements).await?
        }
        Input::Step { sequence, step } => self::step(&app, &model, version, sequence, step).await?,
    };
    let infer = began.elapsed().saturating_sub(input);
    let predictions = match answered {
        Ok(predictions) => predictions,
        Err(problem) => {
            app.statistics.refused(&model.name, version, began.elapsed());
            return Err(problem);
        }
    };
    let differs = rel_speed_differs(&request.input, app.ingest.checks.max_rel_speed_error_mps);
    let answer = answer(&model.name, version, &request, &predictions, differs);
    let output = began.elapsed().saturating_sub(input + infer);
    let times = InferenceTimes { input, infer, output };
    app.statistics.answered(&model.name, version, predictions.len() as u64, times);
    Ok(answer)
}

/// Long or compressed bodies are understood off the async runtime.
async fn understood_somewhere(app: &Arc<AppState>, headers: HeaderMap, held: Held) -> Result<Request, Problem> {
    let app = Arc::clone(app);
    let small = held.bytes.len() <= INLINE_BYTES && !headers.contains_key(axum::http::header::CONTENT_ENCODING);
    let understand = move || {
        let held = decompressed(&headers, held, &app)?;
        understood(&headers, &held.bytes)
    };
    if small { understand() } else { tokio::task::spawn_blocking(understand).await.map_err(Problem::internal)? }
}

/// The version that a request was for, and what it answered.
type Answered = (i64, Result<Vec<Prediction>, Problem>);

async fn windows(
    app: &AppState,
    model: &ServedAt,
    version: Option<i64>,
    [count, horizon]: [usize; 2],
    elements: &[f32],
) -> Result<Answered, Problem> {
    let most = app.settings.predict_windows_max;
    if !(1..=most).contains(&count) {
        return Err(wrong("window", "out_of_range", format!("{count} windows; 1 to {most} are taken at once")));
    }
    let loaded = load(app, model, version).await?;
    let version = loaded.version();
    let predicted = async {
        if horizon != loaded.horizon() {
            let detail = format!("{horizon} steps; exactly the last {} are needed, oldest first", loaded.horizon());
            return Err(wrong("window", "window_length", detail));
        }
        let _slot = slot_for(app, count)?;
        let windows = elements.chunks_exact(horizon * COLUMNS).map(window).collect();
        compute(app, model, loaded, windows).await
    };
    Ok((version, predicted.await))
}

/// A window out of its rows.
fn window(rows: &[f32]) -> Window {
    let column = |at: usize| rows.iter().skip(at).step_by(COLUMNS).copied().collect();
    Window { follower_speed_mps: column(0), leader_speed_mps: column(1), spacing_m: column(3) }
}

async fn step(
    app: &AppState,
    model: &ServedAt,
    version: Option<i64>,
    sequence: &Sequence,
    step: &[f32; COLUMNS],
) -> Result<Answered, Problem> {
    let (id, now, began) = (&sequence.id, seen(step), Instant::now());
    let (version, answered) = if sequence.starts {
        let loaded = load(app, model, version).await?;
        (loaded.version(), app.sequences.start(model.model_id, id.clone(), loaded, now))
    } else {
        let pinned = app.sequences.version(model.model_id, id).map_err(|e| told(model, e))?;
        if let Some(named) = version.filter(|&named| named != pinned) {
            return Err(other_version(named, pinned));
        }
        let onto = if sequence.follows_live { Some(load(app, model, None).await?) } else { None };
        match app.sequences.step(model.model_id, id, now, onto) {
            Ok((version, prediction)) => (version, Ok(prediction)),
            Err(error) => (pinned, Err(error)),
        }
    };
    let counted = answered.map_err(|e| told(model, e)).and_then(|prediction| {
        if sequence.ends {
            app.sequences.end(model.model_id, id.clone());
        }
        let flags = std::iter::once(prediction.flags.as_slice());
        app.metrics.predicted(&model.name, version, PredictionKind::Step, began.elapsed(), flags);
        let predictions = vec![prediction];
        check_finite(version, &predictions).map(|()| predictions)
    });
    Ok((version, counted))
}

fn other_version(named: i64, pinned: i64) -> Problem {
    let detail = format!(
        "the sequence began with version {pinned} and stays with it; version {named} answers one that begins with it, and \
         what serves goes on with this one where the parameter sequence_follow_live is true"
    );
    Code::InvalidBody.because(detail.clone()).with_error(InputError::at("/parameters/sequence_id", "pinned", detail))
}

fn told(model: &ServedAt, error: SequenceError) -> Problem {
    match error {
        SequenceError::Unknown => {
            let detail = "no such sequence is open: it never began, it ended, or nothing came of it for too long; the \
                          parameter sequence_start begins one";
            let error = InputError::at("/parameters/sequence_id", "unknown_sequence", detail);
            Code::InvalidBody.because("the sequence is not open").with_error(error)
        }
        SequenceError::Full => Problem::busy(Code::Busy, "as many sequences as the server keeps are open"),
        SequenceError::Predict(error) => refusal(model, error),
    }
}

/// Whether a relative speed is not leader minus follower. It is not refused: the network computes its own.
fn rel_speed_differs(input: &Input, most_mps: f64) -> bool {
    let rows: &[f32] = match input {
        Input::Windows { elements, .. } => elements,
        Input::Step { step, .. } => step,
    };
    let differs = |row: &[f32]| (f64::from(row[2]) - (f64::from(row[1]) - f64::from(row[0]))).abs() > most_mps;
    rows.chunks_exact(COLUMNS).any(differs)
}
