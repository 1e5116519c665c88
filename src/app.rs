//! Wiring: from settings and a socket to a running server.

use std::future::{Future, IntoFuture};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use jiff::Timestamp;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout_at};

use crate::config::Config;
use crate::http::{AppState, Evaluator, InFlight, RequestIds, router, tally};
use crate::predictor::{Predictor, TrialSettings};
use crate::scheduler::{Scheduler, Training};
use crate::store::Store;
use crate::telemetry::Metrics;

/// Serves on `listener` until `shutdown` resolves; then requests under way may end and training writes its checkpoint,
/// within `server.drain_s`. `ready` is told the address once requests are answered.
///
/// # Errors
/// When the database cannot be opened, or belongs to another process.
pub async fn serve(
    listener: TcpListener,
    config: Config,
    ready: impl FnOnce(SocketAddr) -> std::io::Result<()>,
    shutdown: impl Future<Output = ()>,
) -> anyhow::Result<()> {
    let drain = Duration::from_secs_f64(config.server.drain_s);
    let database = config.database.path.clone();
    let (stop, stopping) = watch::channel(false);
    let state = assemble(config, stopping.clone()).await?;
    let scheduler = state.scheduler.clone();
    let store = Arc::clone(&state.store);
    let address = listener.local_addr().context("the listener has no address")?;
    let mut parts = Parts::start(listener, state, stopping);
    tracing::info!(%address, database = %database.display(), "serving");
    ready(address).context("cannot say where the server listens")?;
    tokio::select! {
        () = shutdown => {}
        ended = &mut parts.server => {
            ended.context("the server broke")??;
            anyhow::bail!("the server ended by itself");
        }
    }
    tracing::info!("stopping");
    let deadline = Instant::now() + drain;
    stop.send_replace(true);
    scheduler.shut_down();
    parts.drain(deadline).await;
    if timeout_at(deadline + LAST_WRITES, store.close()).await.is_err() {
        tracing::warn!("the database was not closed in time; its write-ahead log is read at the next start");
    }
    tracing::info!("stopped");
    Ok(())
}

/// What is left after the drain: folding the write-ahead log back.
const LAST_WRITES: Duration = Duration::from_secs(5);

/// Opens the database and loads what serves.
async fn assemble(config: Config, stopping: watch::Receiver<bool>) -> anyhow::Result<Arc<AppState>> {
    let store = Arc::new(Store::open(&config.database).await?);
    store.ensure_default_model(&config.model).await?;
    let predictor = Arc::new(Predictor::new(Arc::clone(&store), config.predict));
    predictor.load_all().await?;
    let learner = Box::new(Training);
    let scheduler =
        Scheduler::new(config.training, Arc::clone(&store), Arc::clone(&predictor), learner, Timestamp::now)?;
    scheduler.take_over().await?;
    let slots = |count| Arc::new(Semaphore::new(count));
    Ok(Arc::new(AppState {
        store,
        scheduler,
        predictor,
        upload_slots: slots(config.server.concurrent_uploads),
        prediction_slots: slots(config.server.concurrent_predictions),
        evaluation_slots: slots(config.server.concurrent_evaluations),
        evaluator: evaluator(config.evaluate)?,
        stream_slots: slots(config.server.concurrent_streams),
        ingest: config.ingest,
        settings: config.server,
        model_defaults: config.model,
        metrics: Metrics::default(),
        stopping,
        in_flight: InFlight::default(),
        request_ids: RequestIds::default(),
    }))
}

fn evaluator(settings: TrialSettings) -> anyhow::Result<Arc<Evaluator>> {
    let workers =
        rayon::ThreadPoolBuilder::new().num_threads(settings.threads).thread_name(|n| format!("evaluate-{n}"));
    Ok(Arc::new(Evaluator { workers: workers.build()?, settings }))
}

/// What runs beside each other.
struct Parts {
    server: JoinHandle<std::io::Result<()>>,
    training: JoinHandle<()>,
    tally: JoinHandle<()>,
}

impl Parts {
    fn start(listener: TcpListener, state: Arc<AppState>, mut stopping: watch::Receiver<bool>) -> Self {
        let scheduler = state.scheduler.clone();
        let server = axum::serve(listener, router(Arc::clone(&state))).with_graceful_shutdown(async move {
            // A sender that is gone stops the server too.
            let _ = stopping.wait_for(|&stop| stop).await;
        });
        Self {
            server: tokio::spawn(server.into_future()),
            training: tokio::spawn(async move { scheduler.run().await }),
            tally: tokio::spawn(tally::run(state)),
        }
    }

    async fn drain(mut self, deadline: Instant) {
        if timeout_at(deadline, &mut self.training).await.is_err() {
            tracing::warn!("training did not reach a checkpoint in time; it goes on from the one before");
            self.training.abort();
        }
        if timeout_at(deadline, &mut self.server).await.is_err() {
            tracing::warn!("requests still under way were cut off");
            self.server.abort();
        }
        self.tally.abort();
    }
}
