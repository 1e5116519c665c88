//! `POST /v1/models/{model}/versions`: a version out of a file.

use std::io::{self, Read, Seek};
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_ENCODING, HeaderMap, LOCATION};
use jiff::Timestamp;

use super::AppState;
use super::answer::Answer;
use super::batches::{digest, said_besides};
use super::body::media_type;
use super::download;
use super::events_body::take_body_within;
use super::idempotency::Repeatable;
use super::path::ModelAt;
use super::problem::{Code, InputError, Problem};
use super::versions;
use crate::artifact::{ArtifactError, Brought, read};
use crate::consolidation::Method;
use crate::ingest::Spooled;
use crate::lineage::Model;
use crate::scheduler::importance_summary;
use crate::store::import::{Import, Imported, ImportedRegime, import};
use crate::store::new_version::NewVersion;
use crate::store::{Actor, StoreError, version};

/// `POST /v1/models/{model}/versions`
pub(super) async fn create(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
    request: Repeatable,
    http: Request,
) -> Result<Answer, Problem> {
    refuse_other_types(http.headers())?;
    refuse_without_events(model.method)?;
    let _turn = download::turn(&app)?;
    let said = said_besides(&http);
    let body = take_body_within(&app, http, app.settings.artifact_bytes).await?;
    let request_sha256 = digest(&said, &body.sha256);
    if let Some(answer) = request.recall(request_sha256).await? {
        return Ok(answer);
    }
    let file_sha256 = hex::encode(body.sha256);
    let brought = understand(body, &model).await?;
    let (from, tainted) = told(&brought, &file_sha256);
    let policy = model.settings.promotion;
    let decide = |live| policy.of_import(&from, live, tainted);
    let mut tx = app.store.begin_for(&by).await?;
    let done = import(&mut tx, model.model_id, to_import(&model, brought), decide, Timestamp::now()).await?;
    let Imported { version, live } = done.map_err(|occupied| Code::TasksUnderWay.because(occupied.to_string()))?;
    let written = version::get(&mut tx, model.model_id, version).await?;
    let written = written.ok_or_else(|| StoreError::malformed("version", "it was just written"))?;
    let location = format!("/v1/models/{}/versions/{version}", model.name);
    let answer = Answer::json(StatusCode::CREATED, &versions::body(&app, &model, &written));
    let answer = answer.with_header(&LOCATION, location);
    request.keep(&mut tx, request_sha256, &answer).await?;
    tx.commit().await?;
    if live {
        app.predictor.refresh(model.model_id).await;
    }
    tracing::info!(model = %model.name, version, live, file_sha256, "version imported");
    Ok(answer)
}

/// A file is taken as it is.
fn refuse_other_types(headers: &HeaderMap) -> Result<(), Problem> {
    if headers.get(CONTENT_ENCODING).is_some_and(|encoding| encoding != "identity") {
        return Err(Code::UnsupportedMediaType.because("a file of weights is taken without Content-Encoding"));
    }
    match media_type(headers).as_deref() {
        Some("application/octet-stream" | "application/vnd.safetensors") => Ok(()),
        _ => Err(Code::UnsupportedMediaType
            .because("this call takes a safetensors file, as application/octet-stream or application/vnd.safetensors")),
    }
}

/// Methods that learn from what the line has learned cannot go on from a file, which brings no events.
fn refuse_without_events(method: Method) -> Result<(), Problem> {
    if method != Method::Joint && !method.replays() {
        return Ok(());
    }
    let detail = format!("{} learns from the stored events of its line, and a file brings none", method.as_str());
    Err(Code::MethodNeedsEvents.because(detail))
}

/// Reads the file, on a thread that may block.
async fn understand(body: Spooled, model: &Model) -> Result<Brought, Problem> {
    let (method, settings) = (model.method, model.settings.clone());
    let reading = tokio::task::spawn_blocking(move || {
        let bytes = whole(body)?;
        Ok::<_, io::Error>(read(&bytes, method, &settings))
    });
    let read = reading.await.map_err(Problem::internal)?.map_err(Problem::internal)?;
    read.map_err(unusable)
}

fn whole(Spooled { mut file, bytes, .. }: Spooled) -> io::Result<Vec<u8>> {
    let mut all = Vec::with_capacity(usize::try_from(bytes).map_err(io::Error::other)?);
    file.rewind()?;
    file.read_to_end(&mut all)?;
    Ok(all)
}

fn unusable(error: ArtifactError) -> Problem {
    let detail = error.to_string();
    match error {
        ArtifactError::Malformed(_) => Code::MalformedBody.because(detail),
        ArtifactError::Unusable(defects) => {
            let errors = defects.into_iter().map(|it| InputError::at(it.pointer, it.code, it.detail));
            Code::InvalidBody.because(detail).with_errors(errors.collect())
        }
    }
}

/// Where it is from, for a person, and whether it learned what was retracted there.
fn told(brought: &Brought, file_sha256: &str) -> (String, bool) {
    match &brought.origin {
        Some(origin) => {
            let (model, version) = (&origin.model, origin.version);
            (format!("imported: version {version} of {model}, file {file_sha256}"), origin.tainted)
        }
        None => (format!("imported: a network trained elsewhere, file {file_sha256}"), false),
    }
}

fn to_import(model: &Model, brought: Brought) -> Import {
    let own = brought.regimes.iter().find(|one| one.regime == brought.regime);
    let importance = importance_summary(brought.settings.shape(), own.and_then(|one| one.memory.as_ref()));
    let regimes = brought.regimes.into_iter();
    Import {
        stage: brought.stage,
        regime: brought.regime,
        regimes: regimes
            .map(|one| ImportedRegime { regime: one.regime, stage: one.stage, memory: one.memory })
            .collect(),
        version: NewVersion {
            method: model.method,
            settings: brought.settings,
            strength: brought.strength,
            lambda: brought.lambda,
            strength_search: None,
            kernel: brought.kernel,
            train_events: brought.train_events,
            events_sha256: brought.events_sha256,
            scaling: serde_json::to_value(brought.scaling).expect("a scaling is plain data"),
            importance,
            weights: brought.weights,
        },
    }
}
