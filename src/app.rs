//! Wiring: from settings and a socket to a running server.

/// The key that a server begins with.
mod first_key;
/// Without a listener.
mod inside;

use std::future::Future;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use jiff::Timestamp;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout_at};

pub use inside::Inside;

use crate::config::Config;
use crate::http::{
    AppState, Evaluator, Gate, InFlight, Interface, Refusals, RequestIds, Tls, Unloaded, connections, tally,
};
use crate::predictor::{Predictor, Sequences, TrialSettings};
use crate::scheduler::{Scheduler, Training, step_back};
use crate::store::Store;
use crate::telemetry::{Metrics, Statistics};
use crate::upkeep::Upkeep;

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
    let [drain, close] = [config.server.drain_s, config.server.close_s].map(Duration::from_secs_f64);
    let database = config.database.path.clone();
    let (stop, stopping) = watch::channel(false);
    let background = Background::start()?;
    let upkeep = config.upkeep.clone();
    let address = listener.local_addr().context("the listener has no address")?;
    let tls = Tls::load(&config.server.tls)?;
    let store = Store::open(&config.database).await?;
    let gate = first_key::gate(&store, &config, address).await?;
    let state = assemble(config, store, gate, stopping.clone()).await?;
    let upkeep = Upkeep::new(Arc::clone(&state.store), state.scheduler.clone(), Arc::clone(&state.predictor), upkeep);
    let scheduler = state.scheduler.clone();
    let store = Arc::clone(&state.store);
    if let Some(tls) = &tls {
        background.spawn(tls.follow()?);
    }
    background.spawn(upkeep.run(stopping.clone()));
    let mut parts = Parts::start(listener, tls, state, stopping, &background);
    tracing::info!(%address, database = %database.display(), "serving");
    ready(address).context("cannot say where the server listens")?;
    tokio::select! {
        () = shutdown => {}
        ended = &mut parts.server => {
            ended.context("the server broke")?;
            anyhow::bail!("the server ended by itself");
        }
    }
    tracing::info!("stopping");
    let deadline = Instant::now() + drain;
    stop.send_replace(true);
    scheduler.shut_down();
    parts.drain(deadline).await;
    if timeout_at(deadline + close, store.close()).await.is_err() {
        tracing::warn!("the database was not closed in time; its write-ahead log is read at the next start");
    }
    tracing::info!("stopped");
    Ok(())
}

/// Loads what serves, and takes over what an earlier process left.
async fn assemble(
    config: Config,
    store: Store,
    gate: Gate,
    stopping: watch::Receiver<bool>,
) -> anyhow::Result<Arc<AppState>> {
    let store = Arc::new(store);
    store.ensure_default_model(&config.model).await?;
    let sequences = Arc::new(Sequences::new(&config.predict));
    let predictor = Arc::new(Predictor::new(Arc::clone(&store), config.predict));
    predictor.load_all().await?;
    let learner = Box::new(Training);
    let niceness = config.training.niceness;
    let scheduler =
        Scheduler::new(config.training, Arc::clone(&store), Arc::clone(&predictor), learner, Timestamp::now)?;
    scheduler.take_over().await?;
    let slots = |count| Arc::new(Semaphore::new(count));
    Ok(Arc::new(AppState {
        store,
        gate,
        scheduler,
        predictor,
        upload_slots: slots(config.server.concurrent_uploads),
        prediction_slots: slots(config.server.concurrent_predictions),
        evaluation_slots: slots(config.server.concurrent_evaluations),
        evaluator: evaluator(config.evaluate, niceness)?,
        artifact_slots: slots(config.server.concurrent_artifacts),
        copy_slots: slots(config.server.concurrent_copies),
        stream_slots: slots(config.server.concurrent_streams),
        backup: config.backup,
        backup_slot: slots(1),
        body_room: slots(config.server.json_bodies_bytes as usize),
        ingest: config.ingest,
        sequences,
        unloaded: Unloaded::default(),
        statistics: Statistics::new(config.server.counted_versions),
        metrics: Metrics::new(config.server.counted_versions, config.server.counted_regimes),
        settings: config.server,
        model_defaults: config.model,
        stopping,
        in_flight: InFlight::default(),
        refusals: Refusals::new(Duration::from_secs_f64(config.access.refusal_log_s)),
        request_ids: RequestIds::default(),
    }))
}

fn evaluator(settings: TrialSettings, niceness: u8) -> anyhow::Result<Arc<Evaluator>> {
    let workers = rayon::ThreadPoolBuilder::new()
        .num_threads(settings.threads)
        .start_handler(move |_| step_back(niceness))
        .thread_name(|n| format!("evaluate-{n}"));
    Ok(Arc::new(Evaluator { workers: workers.build()?, settings }))
}

/// A runtime apart from the one that answers: whatever a task does, from loading its events to writing its version, happens
/// here, so that no request waits behind it.
#[derive(Debug)]
struct Background(Option<Runtime>);

impl Background {
    fn start() -> std::io::Result<Self> {
        let mut runtime = tokio::runtime::Builder::new_multi_thread();
        Ok(Self(Some(runtime.worker_threads(1).thread_name("background").enable_all().build()?)))
    }

    fn spawn(&self, work: impl Future<Output = ()> + Send + 'static) -> JoinHandle<()> {
        self.0.as_ref().expect("there until it is dropped").spawn(work)
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        // What still computes is not waited for.
        self.0.take().expect("dropped once").shutdown_background();
    }
}

/// What runs beside each other.
struct Parts {
    server: JoinHandle<()>,
    training: JoinHandle<()>,
    tally: JoinHandle<()>,
}

impl Parts {
    fn start(
        listener: TcpListener,
        tls: Option<Arc<Tls>>,
        state: Arc<AppState>,
        stopping: watch::Receiver<bool>,
        background: &Background,
    ) -> Self {
        let scheduler = state.scheduler.clone();
        background.spawn(tidied(state.metrics.clone(), Arc::clone(&state.sequences)));
        let (interface, settings) = (Interface::new(Arc::clone(&state)), state.settings.clone());
        let server = async move { connections::serve(listener, tls, interface, &settings, stopping).await };
        Self {
            server: tokio::spawn(server),
            training: background.spawn(async move { scheduler.run().await }),
            tally: background.spawn(tally::run(state)),
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

/// Keeps the metrics from growing with every request where nobody reads them, and lets go of vehicles that went.
async fn tidied(metrics: Metrics, sequences: Arc<Sequences>) {
    let mut every = tokio::time::interval(Duration::from_secs(1));
    loop {
        every.tick().await;
        metrics.tidy();
        sequences.tidy();
    }
}

#[cfg(test)]
mod tests {
    use axum::body::{Body, to_bytes};
    use axum::http::header::CONTENT_TYPE;
    use axum::http::{Request, Response};
    use serde_json::{Value, json};

    use super::*;
    use crate::config::Layer;
    use crate::http::Need;

    async fn post(interface: &Interface, path: &str, body: &Value) -> (u16, Value) {
        let request = Request::post(path).header(CONTENT_TYPE, "application/json").body(Body::from(body.to_string()));
        answered(interface.answer(request.unwrap()).await).await
    }

    async fn answered(response: Response<Body>) -> (u16, Value) {
        let status = response.status().as_u16();
        let body = to_bytes(response.into_body(), usize::MAX).await.unwrap();
        (status, serde_json::from_slice(&body).unwrap())
    }

    /// A server whose model `default` has learned something small.
    async fn learned(directory: &tempfile::TempDir) -> (Arc<AppState>, Interface) {
        let settings = "[model]\nhidden = 3\nhorizon = 5\nepochs = 1\nschedule = \"manual\"\npromotion = \"auto\"";
        let database = directory.path().join("headway.db");
        let layers = [
            Layer::text("tests", settings).unwrap(),
            Layer::string("tests", "database.path", database.to_str().unwrap()),
            Layer::string("tests", "ingest.spool_folder", directory.path().to_str().unwrap()),
        ];
        // Nobody looks at it here.
        let (_, stopping) = watch::channel(false);
        let config = Config::resolve(layers).unwrap();
        let store = Store::open(&config.database).await.unwrap();
        let gate = Gate::new(config.access.clone(), Vec::new());
        let state = assemble(config, store, gate, stopping).await.unwrap();
        let interface = Interface::new(Arc::clone(&state));
        let event = |speed: f64| {
            let same = |value| vec![value; 30];
            json!({"event_id": speed.to_string(), "split": "train", "dt_s": 0.1, "spacing_m": same(20.0),
                   "follower_speed_mps": same(speed), "leader_speed_mps": same(speed)})
        };
        let events = json!({"events": [event(8.0), event(9.0), event(10.0)]});
        assert_eq!(post(&interface, "/v1/models/default/batches", &events).await.0, 201);
        assert_eq!(post(&interface, "/v1/models/default/tasks", &json!({"batches": "pending"})).await.0, 202);
        state.scheduler.tick().await.unwrap();
        state.scheduler.settled().await;
        (state, interface)
    }

    #[tokio::test]
    async fn a_prediction_by_what_is_live_asks_the_database_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let (state, interface) = learned(&directory).await;
        let window =
            json!({"follower_speed_mps": vec![9; 5], "leader_speed_mps": vec![9; 5], "spacing_m": vec![20; 5]});
        let predict = async |version: Value| {
            let body = json!({"windows": [&window], "version": version});
            post(&interface, "/v1/models/default/predict", &body).await
        };
        let before = predict(Value::Null).await;
        assert_eq!(before.0, 200, "{}", before.1);
        state.store.close().await;
        assert_eq!(predict(Value::Null).await, before);
        assert_eq!(predict(json!(1)).await, before);
        let simulate = json!({"initial": window, "leader_speed_mps": vec![9.0; 20]});
        assert_eq!(post(&interface, "/v1/models/default/simulate", &simulate).await.0, 200);
        let listed = interface.answer(Request::get("/v1/models/default").body(Body::empty()).unwrap()).await;
        assert_eq!(answered(listed).await.0, 500, "the database is closed");
    }

    #[tokio::test]
    async fn who_has_no_key_is_refused_without_the_database() {
        let directory = tempfile::tempdir().unwrap();
        let (state, interface) = learned(&directory).await;
        assert_eq!(post(&interface, "/v1/keys", &json!({"scopes": ["admin"]})).await.0, 201);
        state.store.close().await;
        for (path, method, need) in crate::http::needs() {
            if need == Need::Nothing {
                continue;
            }
            let path = path.replace("{model}", "default").replace(['{', '}'], "");
            let request = Request::builder().method(&method).uri(&path).body(Body::empty()).unwrap();
            assert_eq!(answered(interface.answer(request).await).await.0, 401, "{method} {path}");
        }
    }
}
