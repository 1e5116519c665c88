//! `/v1/models/{model}/versions/{version}/artifact`: a version as a file.

use std::collections::VecDeque;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use futures_util::stream;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use tokio::sync::OwnedSemaphorePermit;

use super::AppState;
use super::distilled;
use super::download::{self, PIECE_BYTES, Tag};
use super::path::{ModelAt, VersionAt};
use super::problem::{Code, InputError, Problem};
use super::query::Query;
use super::versions;
use crate::artifact::{OnnxNames, Record, RememberedRegime, header, onnx, weights_data};
use crate::driver::Scaling;
use crate::lineage::{Model, Version};
use crate::store::{Store, StoreError};

/// The query of a download.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    format: Option<String>,
}

#[derive(Debug, Clone, Copy)]
enum Format {
    Safetensors,
    Onnx,
    Sumo,
}

impl Format {
    /// How the name of a file of it ends, and what it is.
    fn file(self) -> (&'static str, &'static str) {
        match self {
            Self::Safetensors => ("safetensors", "application/octet-stream"),
            Self::Onnx => ("onnx", "application/octet-stream"),
            Self::Sumo => ("add.xml", "application/xml"),
        }
    }
}

impl Wanted {
    fn format(&self) -> Result<Format, Problem> {
        match self.format.as_deref() {
            Some("safetensors") => Ok(Format::Safetensors),
            Some("onnx") => Ok(Format::Onnx),
            Some("sumo") => Ok(Format::Sumo),
            other => {
                let (code, given) = other.map_or(("missing", "nothing"), |given| ("invalid_value", given));
                let detail = format!("safetensors, onnx or sumo, not {given:.64}");
                let error = InputError::parameter("format", code, detail);
                Err(Code::InvalidQuery.because("format is to be safetensors, onnx or sumo").with_error(error))
            }
        }
    }
}

/// `GET /v1/models/{model}/versions/{version}/artifact`
pub(super) async fn download(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    VersionAt(number): VersionAt,
    headers: HeaderMap,
    Query(wanted): Query<Wanted>,
) -> Result<Response, Problem> {
    let format = wanted.format()?;
    let turn = download::turn(&app)?;
    let version = versions::find(&app, &model, number).await?;
    let weights = weights(&app, &model, &version).await?;
    let file = match format {
        Format::Onnx => whole(onnx_file(&model, &version, &weights)?),
        Format::Safetensors => safetensors_file(&app, &model, &version, &weights).await?,
        Format::Sumo => whole(distilled::file(&app, &model, &version).await?),
    };
    let (suffix, media_type) = format.file();
    let name = format!("{}-v{}.{suffix}", model.name, version.version);
    if let Some(known) = file.tag.not_modified(&headers) {
        return Ok(known);
    }
    let (tag, bytes) = (file.tag.clone(), file.bytes);
    Ok(tag.on(download::file(&name, media_type, body(file, app, turn)), bytes))
}

/// The version's weights, where there are any and they are what was written.
async fn weights(app: &AppState, model: &Model, version: &Version) -> Result<Vec<f32>, Problem> {
    let pruned = || Code::VersionPruned.because(format!("the weights of version {} were not kept", version.version));
    if version.pruned {
        return Err(pruned());
    }
    if let Some(detail) = &version.corrupt {
        return Err(Code::Corrupt.because(detail.clone()));
    }
    match app.store.weights(model.model_id, version.version).await {
        Ok(weights) if weights.len() == version.settings.shape().layout().len() => Ok(weights),
        Ok(_) => Err(Problem::internal("a version with the weights of another network")),
        Err(error @ StoreError::Corrupt { .. }) => Err(error.into()),
        // Its weights may have gone meanwhile.
        Err(error) => match versions::find(app, model, version.version).await? {
            now if now.pruned => Err(pruned()),
            _ => Err(error.into()),
        },
    }
}

/// A file that is to be sent.
struct File {
    tag: Tag,
    bytes: u64,
    /// What is there already.
    pieces: VecDeque<Bytes>,
    /// Anchors that follow, each its importance and its weights, read when it is their turn.
    anchors: VecDeque<i64>,
}

fn whole(bytes: Vec<u8>) -> File {
    let tag = Tag::new(Sha256::digest(&bytes).into());
    File { tag, bytes: bytes.len() as u64, pieces: [bytes.into()].into(), anchors: VecDeque::new() }
}

fn onnx_file(model: &Model, version: &Version, weights: &[f32]) -> Result<Vec<u8>, Problem> {
    let scaling: Scaling = serde_json::from_value(version.scaling.clone()).map_err(Problem::internal)?;
    let names =
        OnnxNames { model: model.name.as_str(), version: version.version, weights_sha256: &version.weights_sha256 };
    Ok(onnx(version.settings.shape(), &scaling, weights, &names))
}

/// Looks at everything that will be sent before the first byte is; the header has the digest of all of it.
async fn safetensors_file(app: &AppState, model: &Model, version: &Version, weights: &[f32]) -> Result<File, Problem> {
    let mut anchors = VecDeque::new();
    let mut regimes = Vec::new();
    for regime in app.store.line_regimes(model.model_id, version.version).await? {
        let mut remembered = RememberedRegime {
            regime: regime.evaluation.regime,
            stage: regime.evaluation.learned_stage,
            samples: None,
            anchor_sha256: None,
        };
        if let Some(anchor_id) = regime.anchor_id {
            let kept = app.store.kept_anchor(anchor_id).await?;
            remembered.samples = Some(kept.samples);
            remembered.anchor_sha256 = Some(hex::encode(kept.sha256));
            anchors.push_back(anchor_id);
        }
        regimes.push(remembered);
    }
    let layout = version.settings.shape().layout();
    let header = header(&record(model, version, regimes), layout);
    Ok(File {
        tag: Tag::new(Sha256::digest(&header.bytes).into()),
        bytes: header.file_bytes,
        pieces: [header.bytes.into(), weights_data(layout, weights).into()].into(),
        anchors,
    })
}

fn record(model: &Model, version: &Version, regimes: Vec<RememberedRegime>) -> Record {
    Record {
        model: model.name.clone(),
        version: version.version,
        method: version.method,
        stage: version.stage,
        regime: version.regime.clone(),
        regimes,
        settings: version.settings.clone(),
        strength: version.strength,
        lambda: version.lambda,
        kernel: version.kernel.clone(),
        train_events: version.train_events,
        events_sha256: version.events_sha256.clone(),
        scaling: version.scaling.clone(),
        weights_sha256: version.weights_sha256.clone(),
        tainted: version.tainted,
    }
}

/// The file in pieces; nobody else gets the turn until it is sent or given up.
fn body(file: File, app: Arc<AppState>, turn: OwnedSemaphorePermit) -> Body {
    let unsent = (file, app, turn);
    Body::from_stream(stream::try_unfold(unsent, |(mut file, app, turn)| async move {
        Ok::<_, StoreError>(file.next(&app.store).await?.map(|piece| (piece, (file, app, turn))))
    }))
}

impl File {
    async fn next(&mut self, store: &Store) -> Result<Option<Bytes>, StoreError> {
        if self.pieces.is_empty()
            && let Some(anchor_id) = self.anchors.pop_front()
        {
            let kept = store.kept_anchor(anchor_id).await?;
            self.pieces.extend([kept.importance.into(), kept.anchor.into()]);
        }
        let Some(mut piece) = self.pieces.pop_front() else { return Ok(None) };
        if piece.len() > PIECE_BYTES {
            self.pieces.push_front(piece.split_off(PIECE_BYTES));
        }
        Ok(Some(piece))
    }
}
