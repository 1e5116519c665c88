//! `POST /v1/models/{model}/evaluate`: versions and reference drivers on events that are not kept.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::extract::{Request, State};
use jiff::Timestamp;
use rayon::ThreadPool;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use tokio::sync::OwnedSemaphorePermit;

use super::AppState;
use super::answer::Answer;
use super::events_body::{ingest_problem, kind, option_problem, take_body};
use super::path::{ModelAt, parse_id};
use super::problem::{Code, InputError, Problem, RequestContext};
use super::query::Query;
use super::versions;
use crate::car_following::Event;
use crate::ingest::{Examined, Upload, UploadOptions, examine};
use crate::lineage::{Model, RegimeEvaluation, RegimeName};
use crate::predictor::{PredictError, Scope, TrialSettings, TriedReference, TriedRegime, TriedVersion};
use crate::reference::ReferenceKind;

/// Threads and settings of evaluations.
#[derive(Debug)]
pub struct Evaluator {
    /// What drives; training has threads of its own.
    pub workers: ThreadPool,
    /// How much is computed for a request.
    pub settings: TrialSettings,
}

/// What the query asks for beside the options of an upload.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Asked {
    versions: Option<String>,
    references: Option<String>,
}

/// `POST /v1/models/{model}/evaluate`
pub(super) async fn evaluate(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    context: RequestContext,
    http: Request,
) -> Result<Answer, Problem> {
    let (format, encoding) = kind(http.headers())?;
    let (asked, options) = query(http.uri().query().unwrap_or_default())?;
    options.conversion(format).map_err(|e| option_problem(&e))?;
    options.extraction(format, &app.ingest.extraction).map_err(|e| option_problem(&e))?;
    let (named, references) = asked.names(app.evaluator.settings.max_versions)?;
    let versions = to_drive(&app, &model, named).await?;
    let turn = turn(&app)?;
    let body = take_body(&app, http).await?;
    let (model_id, settings, received_at) = (model.model_id, model.settings.clone(), Timestamp::now());
    let upload = Upload { model_id, model: settings, format, encoding, options, body, received_at };
    let limits = &app.evaluator.settings;
    let examined = examine(upload, &app.ingest, limits.max_steps).await.map_err(ingest_problem)?;
    let mut members = receipt(&examined);
    if examined.events.is_empty() {
        let detail = "no event can be driven; `rejected` says why";
        return Ok(Code::NoEventAccepted.because(detail).with_members(members).answer(&context));
    }
    let trial = app.predictor.trial(&model, &versions, references, by_regime(examined), limits);
    let trial = trial.await.map_err(|e| refusal(&model, e))?;
    let (versions, references) =
        compute(&app, turn, move |Evaluator { workers, settings }| trial.drive(settings, workers)).await?;
    members.insert("model".to_owned(), json!(model.name));
    members.insert("versions".to_owned(), versions.iter().map(|tried| version_body(&model, tried)).collect());
    members.insert("references".to_owned(), reference_bodies(&references));
    Ok(Answer::ok(&members))
}

/// A turn among the evaluations that the server computes at once.
pub(super) fn turn(app: &AppState) -> Result<OwnedSemaphorePermit, Problem> {
    let full = "as many evaluations as the server computes at once are under way";
    Arc::clone(&app.evaluation_slots).try_acquire_owned().map_err(|_| Problem::busy(Code::Busy, full))
}

/// Computes aside from what answers, and gives the turn back, whoever still waits for it.
pub(super) async fn compute<T: Send + 'static>(
    app: &AppState,
    turn: OwnedSemaphorePermit,
    work: impl FnOnce(&Evaluator) -> T + Send + 'static,
) -> Result<T, Problem> {
    let evaluator = Arc::clone(&app.evaluator);
    let computed = tokio::task::spawn_blocking(move || {
        let _turn = turn;
        work(&evaluator)
    });
    computed.await.map_err(Problem::internal)
}

/// What this call asks for, and the options it shares with an upload: they are checked by the same rules.
pub(super) fn query(query: &str) -> Result<(Asked, UploadOptions), Problem> {
    let own = |part: &&str| ["versions", "references"].contains(&part.split('=').next().unwrap_or_default());
    let (asked, options): (Vec<&str>, Vec<&str>) = query.split('&').partition(own);
    Ok((Query::parse(&asked.join("&"))?, Query::parse(&options.join("&"))?))
}

impl Asked {
    /// The versions, at most `most`, and the reference drivers that are named.
    pub(super) fn names(&self, most: usize) -> Result<(Option<Vec<i64>>, Vec<ReferenceKind>), Problem> {
        let versions = self.versions.as_deref().map(|named| versions_named(named, most)).transpose()?;
        Ok((versions, references_named(self.references.as_deref())?))
    }
}

/// The versions named, which are there; the live one when none is.
async fn to_drive(app: &AppState, model: &Model, named: Option<Vec<i64>>) -> Result<Vec<i64>, Problem> {
    let Some(versions) = named else {
        let none = || Code::NoLiveVersion.because(format!("nothing of {} serves yet; name a version", model.name));
        return Ok(vec![model.live.ok_or_else(none)?]);
    };
    for &version in &versions {
        versions::find(app, model, version).await?;
    }
    Ok(versions)
}

/// Versions, each once, in this order.
fn versions_named(named: &str, most: usize) -> Result<Vec<i64>, Problem> {
    let mut versions = Vec::new();
    for part in named.split(',') {
        let version = parse_id("", part).ok_or_else(|| unusable("versions", format!("{part:?} is no version")))?;
        if !versions.contains(&version) {
            versions.push(version);
        }
        if versions.len() > most {
            return Err(unusable("versions", format!("at most {most} are evaluated at once")));
        }
    }
    Ok(versions)
}

/// Reference drivers, each once, in this order.
fn references_named(named: Option<&str>) -> Result<Vec<ReferenceKind>, Problem> {
    let mut references = Vec::new();
    for part in named.into_iter().flat_map(|named| named.split(',')) {
        let known = ReferenceKind::ALL.map(ReferenceKind::as_str).join(", ");
        let kind = ReferenceKind::parse(part)
            .ok_or_else(|| unusable("references", format!("{part:?} is none; there are {known}")))?;
        if !references.contains(&kind) {
            references.push(kind);
        }
    }
    Ok(references)
}

fn unusable(parameter: &'static str, detail: String) -> Problem {
    Code::InvalidQuery.because(detail.clone()).with_error(InputError::parameter(parameter, "invalid_value", detail))
}

pub(super) fn refusal(model: &Model, error: PredictError) -> Problem {
    match error {
        PredictError::UnknownVersion(version) => versions::missing(model.name.as_str(), version),
        PredictError::Unusable(_) => Code::Corrupt.because(error.to_string()),
        PredictError::Pruned(_) => Code::VersionPruned.because(error.to_string()),
        PredictError::Store(error) => error.into(),
        error => Problem::internal(error),
    }
}

/// What became of the body's events, in the members of an upload's answer.
fn receipt(examined: &Examined) -> Map<String, Value> {
    let Examined { events, duplicates, rejected_count, rejected, summary } = examined;
    let receipt = json!({
        "accepted": events.len(),
        "duplicates": duplicates,
        "rejected_count": rejected_count,
        "rejected": rejected,
        "summary": summary,
    });
    receipt.as_object().expect("an object").clone()
}

fn by_regime(examined: Examined) -> BTreeMap<RegimeName, Vec<Event>> {
    let mut regimes = BTreeMap::<_, Vec<_>>::new();
    for arrived in examined.events {
        regimes.entry(arrived.regime).or_default().push(arrived.event);
    }
    regimes
}

fn version_body(model: &Model, tried: &TriedVersion) -> Value {
    let regimes: Vec<RegimeEvaluation> = tried.regimes.iter().map(|regime| regime.evaluation.clone()).collect();
    json!({
        "model": model.name,
        "version": tried.version,
        "stage": tried.stage,
        "tasks": tried.regimes.iter().map(tried_body).collect::<Vec<_>>(),
        "measures": versions::measures(tried.stage, &regimes),
    })
}

fn tried_body(tried: &TriedRegime) -> Value {
    let mut body = versions::regime_body(&tried.evaluation);
    if !tried.learned {
        body["stage"] = Value::Null;
        body["learned_version"] = Value::Null;
    }
    body
}

/// One body a reference driver, with an entry for each regime.
fn reference_bodies(tried: &[TriedReference]) -> Value {
    let bodies = tried.chunk_by(|a, b| a.kind == b.kind).map(|of_kind| {
        let average = versions::mean(of_kind.iter().map(|tried| tried.measures.map(|m| m.spacing_mse)));
        json!({
            "reference": of_kind[0].kind.as_str(),
            "tasks": of_kind.iter().map(reference_body).collect::<Vec<_>>(),
            "measures": {
                "average": { "value": average, "definition": "mean over regimes of the spacing MSE (m²) on their events" },
            },
        })
    });
    bodies.collect()
}

fn reference_body(tried: &TriedReference) -> Value {
    let calibration = &tried.calibration;
    let on = &calibration.on;
    let mut body = json!({
        "regime": tried.regime,
        "events": tried.measures.map_or(0, |measures| measures.events),
        "steps": tried.measures.map_or(0, |measures| measures.steps),
        "parameters": calibration.driver.named_values().map(|(name, value)| (name.to_owned(), json!(value))).collect::<Map<_, _>>(),
        "calibration": {
            "scope": match tried.scope {
                Scope::Regime => "regime",
                Scope::Line => "all_regimes",
                Scope::Published => "published",
            },
            "version": (tried.scope != Scope::Published).then_some(tried.calibrated_on),
            "events": on.events,
            "spacing_mse": (on.steps > 0).then(|| on.spacing_sq / on.steps as f64),
            "evaluations": calibration.evaluations,
        },
    });
    let driven = versions::driven_body(tried.measures.as_ref());
    body.as_object_mut().expect("an object").extend(driven.as_object().expect("an object").clone());
    body
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_query_is_parted_into_what_is_asked_and_how_events_are_read() {
        let (asked, options) = query("versions=1,3&dt_s=0.2&references=idm").unwrap();
        assert_eq!((asked.versions.as_deref(), asked.references.as_deref()), (Some("1,3"), Some("idm")));
        assert_eq!(options.dt_s, Some(0.2));
        assert_eq!(query("").unwrap().1, UploadOptions::default());
        for wrong in ["versions=1&versions=2", "dt_s=soon", "colour=red", "versions&x"] {
            assert!(query(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn references_are_named_once_and_known() {
        assert_eq!(references_named(Some("gipps,idm,gipps")).unwrap(), [ReferenceKind::Gipps, ReferenceKind::Idm]);
        assert_eq!(references_named(None).unwrap(), []);
        for wrong in ["", "IDM", "idm,", "idm;gipps"] {
            assert_eq!(references_named(Some(wrong)).unwrap_err().code(), Code::InvalidQuery, "{wrong}");
        }
    }
}
