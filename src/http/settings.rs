//! Settings of the interface: addresses, limits, patience.

use std::net::SocketAddr;
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::tls::TlsSettings;

/// What the server listens on and how much it takes at once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServerSettings {
    /// Address and port; port 0 picks a free one.
    pub listen: SocketAddr,
    /// Threads that answer requests; 0 takes one a core.
    pub threads: usize,
    /// Largest JSON body of a call other than an upload, bytes.
    pub json_body_bytes: u64,
    /// JSON bodies that came in more than one piece, all of them together while they are received and understood, bytes.
    pub json_bodies_bytes: u32,
    /// Connections open at once; further ones are told 503.
    pub connections: usize,
    /// Longest head, and what a connection reads and writes at once, bytes.
    pub head_bytes: usize,
    /// A request whose head is not complete after so long is given up, s.
    pub head_s: f64,
    /// Clients at once that are told that no further connection is kept.
    pub refused_at_once: usize,
    /// How long each of them may take to hear it, s.
    pub refusal_s: f64,
    /// A body of which nothing comes for so long is given up, s.
    pub body_idle_s: f64,
    /// A body that comes more slowly than this over its whole length is given up, bytes/s; its first `body_idle_s` do not count.
    pub body_bytes_per_s: f64,
    /// An answer of which nothing is read for so long is given up, s.
    pub answer_idle_s: f64,
    /// A connection on which nothing is asked for so long is closed, s.
    pub idle_s: f64,
    /// Uploads received and stored at once.
    pub concurrent_uploads: usize,
    /// Simulations, and predictions too large to wait for company, computed at once.
    pub concurrent_predictions: usize,
    /// Evaluations on events that are not kept, computed at once.
    pub concurrent_evaluations: usize,
    /// Largest file that is taken as a version, bytes.
    pub artifact_bytes: u64,
    /// Files handed out and taken in at once: versions, and events of batches.
    pub concurrent_artifacts: usize,
    /// Models forked, put into archives and taken out of them at once.
    pub concurrent_copies: usize,
    /// Progress streams open at once.
    pub concurrent_streams: usize,
    /// Least time between two progress events of a stream, s.
    pub progress_interval_s: f64,
    /// Windows of one prediction request.
    pub predict_windows_max: usize,
    /// Leader steps of one simulation.
    pub simulate_steps_max: usize,
    /// Errors listed in one problem.
    pub errors_max: usize,
    /// Entries of a list when the client does not say.
    pub page_size: u32,
    /// Most entries of a list, whatever the client says.
    pub page_size_max: u32,
    /// Longest `wait_s` of a task, s.
    pub wait_max_s: f64,
    /// How long answers to requests with an `Idempotency-Key` are kept, s.
    pub idempotency_keep_s: u32,
    /// How long requests under way may take after the server was told to stop, s.
    pub drain_s: f64,
    /// How long closing the database may take after that, s.
    pub close_s: f64,
    /// Versions of a model that have metrics of their own, the newest; those before them share some.
    pub counted_versions: usize,
    /// Regimes of a model's live version that have metrics of their own, those learned last.
    pub counted_regimes: usize,
    /// Origins of web pages whose scripts may use the interface; none: no page's.
    pub cors_origins: Vec<String>,
    /// Encryption.
    pub tls: TlsSettings,
}

impl ServerSettings {
    /// Checks what neither types nor ranges can.
    ///
    /// # Errors
    /// Names the first setting that cannot be used.
    pub fn check(&self) -> Result<(), String> {
        let is_origin = |text: &&String| {
            let host = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://")).unwrap_or_default();
            !host.is_empty() && host.bytes().all(|b| b.is_ascii_alphanumeric() || b"-.:[]".contains(&b))
        };
        match self.cors_origins.iter().find(|text| !is_origin(text)) {
            Some(other) => Err(format!("server.cors_origins: {other:?} is no origin such as https://traffic.example")),
            None => Ok(()),
        }
    }

    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 33] {
        [
            ("threads", self.threads as f64, 0.0..=1024.0),
            ("json_body_bytes", self.json_body_bytes as f64, 1.0..=1e9),
            ("json_bodies_bytes", self.json_bodies_bytes.into(), 1.0..=4e9),
            ("connections", self.connections as f64, 1.0..=1e6),
            // The HTTP library begins each connection with the smallest.
            ("head_bytes", self.head_bytes as f64, 8192.0..=1e9),
            ("head_s", self.head_s, 0.01..=3600.0),
            ("refused_at_once", self.refused_at_once as f64, 0.0..=1e6),
            ("refusal_s", self.refusal_s, 0.01..=3600.0),
            ("body_idle_s", self.body_idle_s, 0.01..=86_400.0),
            ("body_bytes_per_s", self.body_bytes_per_s, 0.001..=1e12),
            ("answer_idle_s", self.answer_idle_s, 0.01..=86_400.0),
            ("idle_s", self.idle_s, 0.01..=86_400.0),
            ("concurrent_uploads", self.concurrent_uploads as f64, 1.0..=10_000.0),
            ("concurrent_predictions", self.concurrent_predictions as f64, 1.0..=10_000.0),
            ("concurrent_evaluations", self.concurrent_evaluations as f64, 1.0..=10_000.0),
            ("artifact_bytes", self.artifact_bytes as f64, 1.0..=4e9),
            ("concurrent_artifacts", self.concurrent_artifacts as f64, 1.0..=10_000.0),
            ("concurrent_copies", self.concurrent_copies as f64, 1.0..=1000.0),
            ("concurrent_streams", self.concurrent_streams as f64, 1.0..=100_000.0),
            ("progress_interval_s", self.progress_interval_s, 0.01..=3600.0),
            ("predict_windows_max", self.predict_windows_max as f64, 1.0..=1e7),
            ("simulate_steps_max", self.simulate_steps_max as f64, 1.0..=1e7),
            ("errors_max", self.errors_max as f64, 1.0..=100_000.0),
            ("page_size", self.page_size.into(), 1.0..=100_000.0),
            ("page_size_max", self.page_size_max.into(), 1.0..=100_000.0),
            ("wait_max_s", self.wait_max_s, 0.0..=86_400.0),
            ("idempotency_keep_s", self.idempotency_keep_s.into(), 0.0..=31_536_000.0),
            ("drain_s", self.drain_s, 0.0..=86_400.0),
            ("close_s", self.close_s, 0.01..=86_400.0),
            ("counted_versions", self.counted_versions as f64, 1.0..=10_000.0),
            ("counted_regimes", self.counted_regimes as f64, 0.0..=10_000.0),
            ("tls.handshake_s", self.tls.handshake_s, 0.01..=3600.0),
            ("tls.look_s", self.tls.look_s, 0.01..=86_400.0),
        ]
    }
}
