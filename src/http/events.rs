//! `/v1/models/{model}/batches/{batch_id}/events`: what a batch holds, as an upload takes it.

use std::io;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use futures_util::stream;
use tokio::sync::OwnedSemaphorePermit;
use tokio::task::spawn_blocking;

use super::AppState;
use super::batches;
use super::download;
use super::path::{BatchAt, ModelAt, batch_id};
use super::problem::Problem;
use super::query::Query;
use super::table::{EVENTS, Wanted, file};
use crate::formats::EventWriter;
use crate::store::StoreError;
use crate::store::contents::Contents;

/// `GET /v1/models/{model}/batches/{batch_id}/events`
pub(super) async fn download(
    State(app): State<Arc<AppState>>,
    ModelAt(model): ModelAt,
    BatchAt(batch): BatchAt,
    headers: HeaderMap,
    Query(wanted): Query<Wanted>,
) -> Result<Response, Problem> {
    let form = wanted.form(&headers, EVENTS)?;
    let turn = download::turn(&app)?;
    let batch = batches::find(&app, &model, batch).await?;
    let name = format!("{}-{}", model.name, batch_id(batch.batch_id));
    let writer = Some(EventWriter::new(form.sheet()).map_err(Problem::internal)?);
    let mut unsent = Unsent { app, contents: Contents::of(batch.batch_id), writer, _turn: turn };
    // What cannot be read from the beginning on is a problem, and not a file that breaks off.
    let first = unsent.piece().await.map_err(|error| match error {
        Broken::Store(error) => error.into(),
        Broken::Written(error) => Problem::internal(error),
    })?;
    let pieces = stream::try_unfold((first, unsent), |(piece, mut unsent)| async move {
        let Some(piece) = piece else { return Ok::<_, Broken>(None) };
        let next = unsent.piece().await?;
        Ok(Some((piece, (next, unsent))))
    });
    Ok(file(form, &name, Body::from_stream(pieces)))
}

/// Why a file breaks off.
#[derive(Debug, thiserror::Error)]
enum Broken {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Written(#[from] io::Error),
}

/// What is still to be sent; nobody else gets the turn until it is, or is given up.
struct Unsent {
    app: Arc<AppState>,
    contents: Contents,
    /// None at the end.
    writer: Option<EventWriter>,
    _turn: OwnedSemaphorePermit,
}

impl Unsent {
    /// The next bytes; none at the end.
    async fn piece(&mut self) -> Result<Option<Bytes>, Broken> {
        let Some(mut writer) = self.writer.take() else { return Ok(None) };
        let events = self.contents.read(&self.app.store).await?;
        let is_last = self.contents.have_ended();
        let written = spawn_blocking(move || {
            let mut bytes = writer.write(&events)?;
            if !is_last {
                return Ok((bytes, Some(writer)));
            }
            bytes.extend(writer.end()?);
            Ok::<_, io::Error>((bytes, None))
        });
        let (bytes, writer) = written.await.map_err(io::Error::other)??;
        self.writer = writer;
        Ok(Some(bytes.into()))
    }
}
