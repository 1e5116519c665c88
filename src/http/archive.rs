//! `/v1/models/{model}/archive`: a model, all of it, as a file; and out of one.

use std::fs::File;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use futures_util::stream;
use tokio::io::AsyncReadExt;
use tokio::runtime::Handle;
use tokio::sync::OwnedSemaphorePermit;

use super::AppState;
use super::answer::Answer;
use super::body::media_type;
use super::download::{self, PIECE_BYTES, Tag};
use super::events_body::take_body;
use super::fork::{BUSY, taken};
use super::gate::Caller;
use super::idempotency::Repeatable;
use super::models;
use super::path::{ModelAt, NewModelAt};
use super::problem::{Code, Problem};
use crate::ingest::Spooled;
use crate::lineage::{Model, ModelName};
use crate::scheduler::step_back;
use crate::store::copy::{Archive, MEDIA_TYPE, note};
use crate::store::{Actor, StoreError};

fn slot(app: &AppState) -> Result<OwnedSemaphorePermit, Problem> {
    Arc::clone(&app.copy_slots).try_acquire_owned().map_err(|_| Problem::busy(Code::Busy, BUSY))
}

/// Does this on a thread that steps back.
async fn aside<T: Send + 'static>(
    app: &AppState,
    work: impl FnOnce() -> Result<T, StoreError> + Send + 'static,
) -> Result<Result<T, StoreError>, Problem> {
    let niceness = app.scheduler.niceness();
    let working = tokio::task::spawn_blocking(move || {
        step_back(niceness);
        work()
    });
    working.await.map_err(Problem::internal)
}

/// `GET /v1/models/{model}/archive`
pub(super) async fn download(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    by: Actor,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let slot = slot(&app)?;
    let (file, bytes, tag) = written(&app, &model).await?;
    if let Some(known) = tag.not_modified(&headers) {
        return Ok(known);
    }
    let mut tx = app.store.begin_for(&by).await?;
    note(&mut tx, &model, bytes).await?;
    tx.commit().await?;
    tracing::info!(model = %model.name, bytes, "an archive was taken");
    let name = format!("{}.headway", model.name);
    Ok(tag.on(download::file(&name, MEDIA_TYPE, body(file, slot)), bytes))
}

/// The archive, which has no name any more, with its length and tag.
async fn written(app: &Arc<AppState>, model: &Model) -> Result<(File, u64, Tag), Problem> {
    let (writer, name) = (Arc::clone(app), model.name.clone());
    let written = aside(app, move || {
        let (database, folder) = (writer.store.path(), &writer.ingest.spool_folder);
        let Some(archive) = Handle::current().block_on(Archive::write(database, &name, folder))? else {
            return Ok(None);
        };
        Ok(Some(archive.unnamed()?))
    });
    match written.await? {
        Ok(Some((file, bytes, digest))) => Ok((file, bytes, Tag::new(digest))),
        Ok(None) => Err(Problem::internal("a model that went")),
        Err(StoreError::Unsound(found)) => {
            let detail = format!("an archive would hold {} faults; `headway verify` lists them", found.faults_in_all());
            Err(Code::Corrupt.because(detail))
        }
        Err(error) => Err(error.into()),
    }
}

/// The file in pieces; nobody else gets the slot until it is sent or given up.
fn body(file: File, slot: OwnedSemaphorePermit) -> Body {
    let unsent = (tokio::fs::File::from_std(file), slot);
    Body::from_stream(stream::try_unfold(unsent, |(mut file, slot)| async move {
        let mut piece = Vec::with_capacity(PIECE_BYTES);
        (&mut file).take(PIECE_BYTES as u64).read_to_end(&mut piece).await?;
        Ok::<_, std::io::Error>((!piece.is_empty()).then(|| (Bytes::from(piece), (file, slot))))
    }))
}

/// `POST /v1/models/{model}/archive`
pub(super) async fn take_in(
    State(app): State<Arc<AppState>>,
    NewModelAt(name): NewModelAt,
    caller: Caller,
    by: Actor,
    request: Repeatable,
    http: Request<Body>,
) -> Result<Answer, Problem> {
    if caller.models().is_some() {
        return Err(
            Code::ModelForbidden.because("the key is for some models only, and a model that is taken in is another")
        );
    }
    if media_type(http.headers()).as_deref() != Some(MEDIA_TYPE) {
        return Err(Code::UnsupportedMediaType.because(format!("this call takes an archive, as {MEDIA_TYPE}")));
    }
    let _slot = slot(&app)?;
    let received = take_body(&app, http).await?;
    let request_sha256 = received.sha256;
    if let Some(answer) = request.recall(request_sha256).await? {
        return Ok(answer);
    }
    if app.store.model(&name).await?.is_some() {
        return Err(taken(&name));
    }
    let archive = examined(&app, received).await?;
    let made = make(&app, &archive, &name, &by, &request, request_sha256).await;
    app.store.let_go().await?;
    let (model, answer) = made?;
    tracing::info!(model = %model.name, method = model.method.as_str(), "a model was taken in");
    app.predictor.refresh(model.model_id).await;
    app.scheduler.wake();
    Ok(answer)
}

/// What was received, if a model can be taken out of it.
async fn examined(app: &Arc<AppState>, mut received: Spooled) -> Result<Archive, Problem> {
    let folder = app.ingest.spool_folder.clone();
    let examined = aside(app, move || {
        let archive = Archive::received(&mut received.file, &folder)?;
        let found = Handle::current().block_on(archive.examine(&|_| ()))?;
        Ok(found.map(|()| archive))
    });
    examined.await??.map_err(|why| Code::InvalidArchive.because(why))
}

async fn make(
    app: &AppState,
    archive: &Archive,
    name: &ModelName,
    by: &Actor,
    request: &Repeatable,
    request_sha256: [u8; 32],
) -> Result<(Model, Answer), Problem> {
    let mut tx = app.store.begin_for(by).await?;
    let made = archive.take_in(&mut tx, name).await.map_err(|error| match error {
        StoreError::Corrupt { detail, .. } => Code::InvalidArchive.because(detail),
        error => error.into(),
    });
    let model = made?.ok_or_else(|| taken(name))?;
    let answer = models::created(&model);
    request.keep(&mut tx, request_sha256, &answer).await?;
    tx.commit().await?;
    Ok((model, answer))
}
