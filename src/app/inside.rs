//! The service within this process and without a listener.

use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

use axum::BoxError;
use axum::body::HttpBody;
use axum::http::Request;
use axum::response::Response;
use bytes::Bytes;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout_at};

use super::{Background, assemble};
use crate::config::Config;
use crate::http::{AppState, Gate, Interface};
use crate::store::Store;

/// Answers whoever runs this process, on a database that no server has open. Whoever can open the file may do everything: no
/// key is asked for.
#[derive(Debug)]
pub struct Inside {
    interface: Interface,
    state: Arc<AppState>,
    stop: watch::Sender<bool>,
    training: Option<JoinHandle<()>>,
    drain: Duration,
    _background: Background,
}

impl Inside {
    /// Opens the database, or makes it. Tasks run only where it `learns`; elsewhere they wait for a server.
    ///
    /// # Errors
    /// When the database cannot be opened, or belongs to another process.
    pub async fn open(config: Config, learns: bool) -> anyhow::Result<Self> {
        let drain = Duration::from_secs_f64(config.server.drain_s);
        let store = Store::open(&config.database).await?;
        let gate = Gate::of_the_owner(config.access.clone());
        let (stop, stopping) = watch::channel(false);
        let state = assemble(config, store, gate, stopping).await?;
        let background = Background::start()?;
        let scheduler = state.scheduler.clone();
        let training = learns.then(|| background.spawn(async move { scheduler.run().await }));
        Ok(Self {
            interface: Interface::new(Arc::clone(&state)),
            state,
            stop,
            training,
            drain,
            _background: background,
        })
    }

    /// The answer to a request, whose URI is a path.
    pub async fn answer<B>(&self, request: Request<B>) -> Response
    where
        B: HttpBody<Data = Bytes> + Send + 'static,
        B::Error: Display + Into<BoxError>,
    {
        self.interface.answer(request).await
    }

    /// Lets a task that runs write its checkpoint, and closes the database.
    pub async fn close(mut self) {
        self.stop.send_replace(true);
        self.state.scheduler.shut_down();
        if let Some(training) = &mut self.training
            && timeout_at(Instant::now() + self.drain, training).await.is_err()
        {
            tracing::warn!("training did not reach a checkpoint in time; it goes on from the one before");
        }
        self.state.store.close().await;
    }
}
