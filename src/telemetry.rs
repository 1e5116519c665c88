//! Logs to stderr, and metrics for `/metrics`.

/// How long things took.
mod durations;
/// How the live versions drive.
mod driving;
/// Panics in the log.
mod panics;
/// Predictions by version.
mod predictions;
/// What the inference protocol tells of versions.
mod statistics;

use std::collections::HashMap;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use metrics::{
    Counter, Histogram, Unit, counter, describe_counter, describe_gauge, describe_histogram, gauge, histogram,
};
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle, PrometheusRecorder};
use serde::{Deserialize, Serialize};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt;

pub use panics::log_panics;
pub use predictions::PredictionKind;
pub use statistics::{InferenceTimes, Statistics, Timed, VersionStatistics};

use crate::lineage::{RegimeEvaluation, TaskState};
use crate::predictor::Flag;
use crate::store::{DatabaseSize, ModelCensus};

/// How the log looks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogSettings {
    /// Text or JSON.
    pub format: LogFormat,
    /// What is logged: `tracing` directives such as `info,headway=debug`.
    pub filter: String,
}

/// How a log line is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// For a person.
    Text,
    /// One object a line.
    Json,
}

/// Sends the process's log to stderr. The first call decides.
///
/// # Errors
/// When the filter cannot be parsed.
pub fn start_logging(settings: &LogSettings) -> Result<(), tracing_subscriber::filter::ParseError> {
    let filter = EnvFilter::builder().parse(&settings.filter)?;
    // Where the log cannot be written, as on a full disk, saying so on the same stderr would panic.
    let builder = fmt().with_env_filter(filter).with_writer(std::io::stderr).log_internal_errors(false);
    // A second server in one process, as in tests, logs with the first.
    let _ = match settings.format {
        LogFormat::Text => builder.try_init(),
        LogFormat::Json => builder.json().try_init(),
    };
    Ok(())
}

/// The metrics of one server; clones share them.
#[derive(Clone)]
pub struct Metrics {
    recorder: Arc<PrometheusRecorder>,
    handle: PrometheusHandle,
    answered: Arc<Answers>,
    predicted: Arc<predictions::Predictions>,
    driving: Arc<driving::Driving>,
}

/// How often, and how long each took.
type Answered = (Counter, Histogram);
/// Of one route, by method and status.
type Route = HashMap<(&'static str, u16), Answered>;

/// Of every route: counted so often that looking them up by their labels would be felt.
#[derive(Default)]
struct Answers(RwLock<HashMap<String, Route>>);

impl Answers {
    /// Those of this route, made when it is the first time.
    fn get(&self, route: &str, key: (&'static str, u16), make: impl FnOnce() -> Answered) -> Answered {
        let known = self.0.read().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known.get(route).and_then(|of_route| of_route.get(&key)) {
            return found.clone();
        }
        drop(known);
        let made = make();
        let mut known = self.0.write().unwrap_or_else(PoisonError::into_inner);
        known.entry(route.to_owned()).or_default().entry(key).or_insert(made).clone()
    }
}

impl std::fmt::Debug for Metrics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Metrics")
    }
}

impl Metrics {
    /// Metrics of which the newest `counted_versions` versions and the `counted_regimes` regimes learned last of a model have
    /// some of their own.
    #[must_use]
    pub fn new(counted_versions: usize, counted_regimes: usize) -> Self {
        let buckets =
            [1e-4, 2.5e-4, 5e-4, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 60.0];
        let task_buckets = [1.0, 5.0, 15.0, 60.0, 300.0, 900.0, 3600.0, 14400.0];
        let matcher = metrics_exporter_prometheus::Matcher::Full("headway_task_duration_seconds".to_owned());
        let recorder = PrometheusBuilder::new()
            .set_buckets(&buckets)
            .and_then(|b| b.set_buckets_for_metric(matcher, &task_buckets))
            .expect("buckets are not empty")
            .build_recorder();
        let handle = recorder.handle();
        let predicted = Arc::new(predictions::Predictions::new(counted_versions));
        let driving = Arc::new(driving::Driving::new(counted_regimes));
        let metrics = Self { recorder: Arc::new(recorder), handle, answered: Arc::default(), predicted, driving };
        metrics.with(describe);
        metrics
    }
}

fn describe() {
    describe_counter!("headway_http_requests_total", Unit::Count, "Requests answered.");
    describe_histogram!("headway_http_request_duration_seconds", Unit::Seconds, "From request to answer's head.");
    describe_counter!("headway_uploads_total", Unit::Count, "Uploads by outcome.");
    describe_counter!("headway_uploaded_bytes_total", Unit::Bytes, "Bytes of uploaded bodies as sent.");
    describe_counter!("headway_events_total", Unit::Count, "Uploaded events by outcome.");
    describe_counter!("headway_tasks_total", Unit::Count, "Tasks that ended, by state.");
    describe_histogram!("headway_task_duration_seconds", Unit::Seconds, "From a task's start to its end.");
    describe_counter!("headway_training_events_total", Unit::Count, "Training events of the versions made.");
    describe_gauge!("headway_live_version", Unit::Count, "The version that serves; 0 when none does.");
    describe_gauge!("headway_serving_version", Unit::Count, "The version that answers; 0 when none does.");
    describe_gauge!("headway_corrupt_versions", Unit::Count, "Versions found corrupt since the server started.");
    describe_gauge!(
        "headway_live_version_tainted",
        Unit::Count,
        "1 when the version that serves has learned what was retracted later."
    );
    describe_gauge!("headway_sources_held", Unit::Count, "Sources whose events wait until they are released.");
    describe_gauge!("headway_database_bytes", Unit::Bytes, "Of the database's file.");
    describe_gauge!("headway_database_wal_bytes", Unit::Bytes, "Of its write-ahead log.");
    describe_gauge!(
        "headway_database_wal_held_seconds",
        Unit::Seconds,
        "How long a reader has kept it from being emptied."
    );
    describe_gauge!("headway_database_unused_bytes", Unit::Bytes, "Of pages in the file that nothing uses.");
    describe_gauge!("headway_tasks", Unit::Count, "Tasks queued and running.");
}

impl Metrics {
    /// What Prometheus reads.
    #[must_use]
    pub fn render(&self) -> String {
        self.handle.run_upkeep();
        self.handle.render() + &self.predicted.render() + &self.driving.render()
    }

    /// Puts recorded durations into their buckets. Until then each is kept by itself: to be called now and then, whether
    /// or not anybody reads.
    pub fn tidy(&self) {
        self.handle.run_upkeep();
    }

    /// A request was answered.
    pub fn http_request(&self, route: &str, method: &'static str, status: u16, elapsed_s: f64) {
        let (answers, durations) = self.answered.get(route, (method, status), || {
            let labels = [("route", route.to_owned()), ("method", method.to_owned()), ("status", status.to_string())];
            self.with(|| {
                let answers = counter!("headway_http_requests_total", &labels);
                (answers, histogram!("headway_http_request_duration_seconds", &labels))
            })
        });
        answers.increment(1);
        durations.record(elapsed_s);
    }

    /// A request's windows were predicted, or its simulation was driven: how long that took, and the flags of each answer.
    pub fn predicted<'f>(
        &self,
        model: &str,
        version: i64,
        kind: PredictionKind,
        took: Duration,
        flags: impl ExactSizeIterator<Item = &'f [Flag]>,
    ) {
        self.predicted.add(model, version, kind, took, flags);
    }

    /// An upload ended.
    pub fn upload(&self, model: &str, outcome: &'static str, bytes: u64, events: [(&'static str, u64); 3]) {
        let model = model.to_owned();
        self.with(|| {
            counter!("headway_uploads_total", "model" => model.clone(), "outcome" => outcome).increment(1);
            counter!("headway_uploaded_bytes_total", "model" => model.clone()).increment(bytes);
            for (outcome, count) in events {
                counter!("headway_events_total", "model" => model.clone(), "outcome" => outcome).increment(count);
            }
        });
    }

    /// A task ended.
    pub fn task_ended(&self, model: &str, state: &'static str, elapsed: Duration, train_events: u64) {
        let model = model.to_owned();
        self.with(|| {
            counter!("headway_tasks_total", "model" => model.clone(), "state" => state).increment(1);
            histogram!("headway_task_duration_seconds", "model" => model.clone(), "state" => state)
                .record(elapsed.as_secs_f64());
            counter!("headway_training_events_total", "model" => model.clone()).increment(train_events);
        });
    }

    /// How things stand with a model.
    #[expect(clippy::cast_precision_loss, reason = "Prometheus counts in f64")]
    pub fn model_state(&self, state: &ModelCensus) {
        let model = state.name.clone();
        self.with(|| {
            gauge!("headway_live_version", "model" => model.clone()).set(state.live.unwrap_or(0) as f64);
            gauge!("headway_live_version_tainted", "model" => model.clone())
                .set(f64::from(u8::from(state.live_tainted)));
            gauge!("headway_sources_held", "model" => model.clone()).set(state.held_sources as f64);
            // There from the beginning: an alert sees no counter that begins with 1.
            for state in [TaskState::Succeeded, TaskState::Failed, TaskState::Cancelled].map(TaskState::as_str) {
                counter!("headway_tasks_total", "model" => model.clone(), "state" => state).increment(0);
            }
            gauge!("headway_tasks", "model" => model.clone(), "state" => "queued").set(state.queued as f64);
            gauge!("headway_tasks", "model" => model.clone(), "state" => "running").set(state.running as f64);
        });
    }

    /// What answers for a model, and how many of its versions were found corrupt.
    #[expect(clippy::cast_precision_loss, reason = "Prometheus counts in f64")]
    pub fn integrity(&self, model: &str, answering: Option<i64>, corrupt: usize) {
        let model = model.to_owned();
        self.with(|| {
            gauge!("headway_serving_version", "model" => model.clone()).set(answering.unwrap_or(0) as f64);
            gauge!("headway_corrupt_versions", "model" => model).set(corrupt as f64);
        });
    }

    /// Whether [`Self::drives`] has been told of this live version of the model.
    #[must_use]
    pub fn knows_driving(&self, model: &str, live: Option<i64>) -> bool {
        self.driving.knows(model, live)
    }

    /// How the version that is live drives in every regime of its line, in the order first learned.
    pub fn drives(&self, model: &str, live: Option<i64>, regimes: &[RegimeEvaluation]) {
        self.driving.set(model, live, regimes);
    }

    /// How large the database is, as it stands.
    #[expect(clippy::cast_precision_loss, reason = "Prometheus counts in f64")]
    pub fn database_size(&self, size: DatabaseSize) {
        self.with(|| {
            gauge!("headway_database_bytes").set(size.database as f64);
            gauge!("headway_database_wal_bytes").set(size.log as f64);
            gauge!("headway_database_wal_held_seconds").set(size.log_held.as_secs_f64());
            gauge!("headway_database_unused_bytes").set(size.unused as f64);
        });
    }

    /// Records into this server's metrics, not into a recorder of the process.
    fn with<T>(&self, record: impl FnOnce() -> T) -> T {
        metrics::with_local_recorder(&*self.recorder, record)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_servers_count_for_themselves() {
        let (one, other) = (Metrics::new(1, 1), Metrics::new(1, 1));
        one.http_request("/healthz", "GET", 200, 0.001);
        let expected = r#"headway_http_requests_total{route="/healthz",method="GET",status="200"} 1"#;
        assert!(one.render().contains(expected), "{}", one.render());
        assert!(!other.render().contains("/healthz"));
    }

    #[test]
    fn the_log_filter_is_checked() {
        let settings = LogSettings { format: LogFormat::Text, filter: "headway=loud".to_owned() };
        assert!(start_logging(&settings).is_err());
    }
}
