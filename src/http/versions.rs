//! `/v1/models/{model}/versions`: what tasks made, and how it drives.

use std::sync::Arc;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use jiff::Timestamp;
use serde::Deserialize;
use serde_json::{Value, json};

use super::answer::Answer;
use super::body::JsonBody;
use super::path::{ModelAt, VersionAt, task_id};
use super::problem::{Code, InputError, Problem};
use super::query::{Page, Query};
use super::table::{self, FIGURES, Wanted};
use super::{AppState, figures};
use crate::lineage::{Model, RegimeEvaluation, ServedMeasures, TestMeasures, Version};
use crate::store::{Actor, StoreError, version};

/// Longest note, in characters.
const MAX_NOTE_CHARS: usize = 4096;

/// The body of a change: the only thing about a version that may change.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Note {
    /// Null removes it. Named as its own deserializer, it must be there.
    #[serde(deserialize_with = "Option::deserialize")]
    note: Option<String>,
}

impl Note {
    /// The note, where there is to be one.
    pub(super) fn text(self) -> Result<Option<String>, Problem> {
        if self.note.as_ref().is_some_and(|note| note.chars().count() > MAX_NOTE_CHARS) {
            let detail = format!("at most {MAX_NOTE_CHARS} characters");
            let error = InputError::at("/note", "too_long", detail);
            return Err(Code::InvalidBody.because("the note is too long").with_error(error));
        }
        Ok(self.note)
    }
}

/// A version as clients see it.
pub(super) fn body(app: &AppState, model: &Model, version: &Version) -> Value {
    let corrupt = version.corrupt.clone().or_else(|| app.store.corruption(version.model_id, version.version));
    json!({
        "model": model.name,
        "version": version.version,
        "parent": version.parent,
        "stage": version.stage,
        "regime": version.regime,
        "task_id": version.task_id.map(task_id),
        "method": version.method,
        "settings": version.settings,
        "seed": version.settings.seed,
        "strength": version.strength,
        "lambda": version.lambda,
        "strength_search": version.strength_search,
        "weights_sha256": version.weights_sha256,
        "events": version.train_events,
        "events_sha256": version.events_sha256,
        "kernel": version.kernel,
        "scaling": version.scaling,
        "importance": version.importance,
        "promotion": version.promotion,
        "corrupt": corrupt,
        "tainted": version.tainted,
        "pruned": version.pruned,
        "note": version.note,
        "created_at": version.created_at.to_string(),
    })
}

/// A 404 for a version the model does not have.
pub(super) fn missing(model: &str, version: i64) -> Problem {
    Code::VersionNotFound.because(format!("{model} has no version {version}"))
}

/// The version of this number.
pub(super) async fn find(app: &AppState, model: &Model, version: i64) -> Result<Version, Problem> {
    app.store.version(model.model_id, version).await?.ok_or_else(|| missing(model.name.as_str(), version))
}

/// `GET /v1/models/{model}/versions`
pub(super) async fn list(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    page: Page,
) -> Result<Answer, Problem> {
    let versions = app.store.versions(model.model_id, page.after, page.fetch()).await?;
    Ok(Answer::ok(&page.body("versions", versions, |version| version.version, |version| body(&app, &model, version))))
}

/// `GET /v1/models/{model}/versions/{version}`
pub(super) async fn read(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    VersionAt(version): VersionAt,
) -> Result<Answer, Problem> {
    let version = find(&app, &model, version).await?;
    if version.pruned {
        return Ok(Answer::ok(&body(&app, &model, &version)));
    }
    // Its weights are looked at here, and not for every version of a list.
    match app.store.weights(model.model_id, version.version).await {
        Ok(_) | Err(StoreError::Corrupt { .. }) => Ok(Answer::ok(&body(&app, &model, &version))),
        Err(error) => match find(&app, &model, version.version).await? {
            // Its weights went meanwhile.
            pruned if pruned.pruned => Ok(Answer::ok(&body(&app, &model, &pruned))),
            _ => Err(error.into()),
        },
    }
}

/// `PATCH /v1/models/{model}/versions/{version}`
pub(super) async fn annotate(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    VersionAt(version): VersionAt,
    by: Actor,
    JsonBody { value, .. }: JsonBody<Note>,
) -> Result<Answer, Problem> {
    let note = value.text()?;
    let mut tx = app.store.begin_for(&by).await?;
    if !version::set_note(&mut tx, model.model_id, version, note.as_deref(), Timestamp::now()).await? {
        return Err(missing(model.name.as_str(), version));
    }
    tx.commit().await?;
    Ok(Answer::ok(&body(&app, &model, &find(&app, &model, version).await?)))
}

/// `GET /v1/models/{model}/versions/{version}/evaluation`
pub(super) async fn evaluation(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    VersionAt(version): VersionAt,
    headers: HeaderMap,
    Query(wanted): Query<Wanted>,
) -> Result<Response, Problem> {
    let form = wanted.form(&headers, FIGURES)?;
    let version = find(&app, &model, version).await?;
    let regimes = app.store.evaluation(model.model_id, version.version).await?;
    if let Some(format) = form.sheet() {
        let rows: Vec<_> = regimes.iter().map(regime_body).collect();
        let name = format!("{}-v{}-evaluation", model.name, version.version);
        return table::answer(form, format, &name, &figures::of_regimes(&rows));
    }
    let body = Answer::ok(&json!({
        "model": model.name,
        "version": version.version,
        "stage": version.stage,
        "tasks": regimes.iter().map(regime_body).collect::<Vec<_>>(),
        "measures": measures(version.stage, &regimes),
    }));
    Ok(body.into_response())
}

/// One regime of an evaluation.
pub(super) fn regime_body(regime: &RegimeEvaluation) -> Value {
    let driven = driven_body(regime.measures.as_ref());
    let mut body = json!({
        "regime": regime.regime,
        "stage": regime.learned_stage,
        "learned_version": regime.learned_version,
        "events": regime.measures.map_or(0, |measures| measures.events),
        "steps": regime.measures.map_or(0, |measures| measures.steps),
        "before": regime.before.map(|before| before.spacing_mse),
        "diagonal_spacing_mse": regime.diagonal_spacing_mse,
        "forgetting_ratio": ratio(regime),
        "served": served_body(regime),
    });
    let members = body.as_object_mut().expect("an object");
    members.extend(driven.as_object().expect("an object").clone());
    body
}

/// Without an envelope what is served is what the network says.
fn served_body(regime: &RegimeEvaluation) -> Value {
    let network = regime.measures.as_ref();
    let served = network.zip(regime.served).map(|(network, served)| TestMeasures {
        spacing_mse: served.spacing_mse,
        speed_mse: served.speed_mse,
        collisions: served.collisions,
        ..*network
    });
    let mut body = driven_body(served.as_ref().or(network));
    let share = |steps: fn(ServedMeasures) -> u64| {
        let of = |network: &TestMeasures| 100.0 * regime.served.map_or(0, steps) as f64 / network.steps as f64;
        network.map(of)
    };
    body["acted_percent"] = json!(share(|served| served.acted_steps));
    body["held_percent"] = json!(share(|served| served.held_steps));
    body
}

/// Errors on driven events; nulls without any.
pub(super) fn driven_body(measures: Option<&TestMeasures>) -> Value {
    let rate = |measures: &TestMeasures| 100.0 * f64::from(measures.collisions) / f64::from(measures.events);
    json!({
        "spacing_mse": measures.map(|m| m.spacing_mse),
        "speed_mse": measures.map(|m| m.speed_mse),
        "collision_rate_percent": measures.map(rate),
    })
}

fn ratio(regime: &RegimeEvaluation) -> Option<f64> {
    Some(regime.measures?.spacing_mse / regime.diagonal_spacing_mse?)
}

/// The continual-learning measures of the spacing error; each carries its definition.
pub(super) fn measures(stage: u32, regimes: &[RegimeEvaluation]) -> Value {
    let earlier = || regimes.iter().filter(|regime| regime.learned_stage < stage);
    let average = mean(regimes.iter().map(|r| Some(r.measures?.spacing_mse)));
    let forgetting = mean(earlier().map(|r| Some(r.measures?.spacing_mse - r.best_spacing_mse?)));
    let backward = mean(earlier().map(|r| Some(r.measures?.spacing_mse - r.diagonal_spacing_mse?)));
    json!({
        "average": {
            "value": average,
            "definition": "mean over regimes j of R[T,j], the spacing MSE (m²) on j's events after this stage T",
        },
        "forgetting": {
            "value": forgetting,
            "definition": "mean over regimes j learned before T of R[T,j] - min R[i,j] over the stages i < T since j was last learned (m²)",
        },
        "forgetting_ratio": {
            "value": mean(earlier().map(ratio)),
            "definition": "mean over regimes j learned before T of R[T,j] / R[j,j]",
        },
        "backward_transfer": {
            "value": backward,
            "definition": "mean over regimes j learned before T of R[T,j] - R[j,j] (m²); positive means forgetting",
        },
    })
}

/// The mean of those that are there; `None` of nothing.
pub(super) fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values.flatten() {
        sum += value;
        count += 1.0;
    }
    (count > 0.0).then(|| sum / count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lineage::RegimeName;

    fn regime(
        name: &str,
        learned_stage: u32,
        now: Option<f64>,
        diagonal: Option<f64>,
        best: Option<f64>,
    ) -> RegimeEvaluation {
        let measures = |spacing_mse| TestMeasures { spacing_mse, speed_mse: 1.0, collisions: 1, events: 4, steps: 400 };
        RegimeEvaluation {
            regime: RegimeName::parse(name).unwrap(),
            learned_stage,
            learned_version: learned_stage.into(),
            measures: now.map(measures),
            served: None,
            before: None,
            diagonal_spacing_mse: diagonal,
            best_spacing_mse: best,
        }
    }

    #[test]
    fn measures_follow_their_definitions() {
        let regimes = [
            regime("fast", 1, Some(12.0), Some(8.0), Some(6.0)),
            regime("middle", 2, Some(4.0), Some(4.0), Some(5.0)),
            regime("slow", 3, Some(2.0), Some(2.0), None),
        ];
        let measures = measures(3, &regimes);
        let value = |name: &str| measures[name]["value"].as_f64().unwrap();
        assert_eq!(value("average"), 6.0);
        assert_eq!(value("forgetting"), f64::midpoint(6.0, -1.0));
        assert_eq!(value("forgetting_ratio"), 1.25);
        assert_eq!(value("backward_transfer"), 2.0);
    }

    #[test]
    fn a_regime_without_test_events_is_nulls_and_counts_nowhere() {
        let regimes = [regime("fast", 1, None, None, None)];
        assert_eq!(measures(1, &regimes)["average"]["value"], Value::Null);
        let body = regime_body(&regimes[0]);
        assert_eq!((&body["events"], &body["spacing_mse"]), (&json!(0), &Value::Null));
        assert_eq!(body["served"]["collision_rate_percent"], Value::Null);
        assert_eq!(regime_body(&regime("a", 1, Some(1.0), None, None))["collision_rate_percent"], json!(25.0));
    }

    #[test]
    fn what_is_served_stands_beside_the_network_and_is_the_network_without_an_envelope() {
        let alone = regime("a", 1, Some(1.0), None, None);
        let body = regime_body(&alone);
        assert_eq!((&body["served"]["spacing_mse"], &body["served"]["acted_percent"]), (&json!(1.0), &json!(0.0)));
        let served = ServedMeasures { spacing_mse: 2.0, speed_mse: 1.0, collisions: 0, acted_steps: 2, held_steps: 4 };
        let body = regime_body(&RegimeEvaluation { served: Some(served), ..alone });
        assert_eq!(body["spacing_mse"], json!(1.0));
        assert_eq!((&body["served"]["spacing_mse"], &body["served"]["acted_percent"]), (&json!(2.0), &json!(0.5)));
        assert_eq!(
            (&body["served"]["collision_rate_percent"], &body["served"]["held_percent"]),
            (&json!(0.0), &json!(1.0))
        );
    }
}
