//! Settings of the interface: addresses, limits, patience.

use std::net::SocketAddr;

use serde::{Deserialize, Serialize};

/// What the server listens on and how much it takes at once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServerSettings {
    /// Address and port; port 0 picks a free one.
    pub listen: SocketAddr,
    /// Largest JSON body of a call other than an upload, bytes.
    pub json_body_bytes: u64,
    /// A body of which nothing comes for so long is given up, s.
    pub body_idle_s: f64,
    /// Uploads received and stored at once.
    pub concurrent_uploads: usize,
    /// Prediction and simulation requests computed at once.
    pub concurrent_predictions: usize,
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
}

impl ServerSettings {
    /// Checks what types cannot.
    ///
    /// # Errors
    /// Names the first setting that cannot be used.
    pub fn check(&self) -> Result<(), String> {
        if !self.listen.ip().is_loopback() {
            return Err(format!(
                "server.listen: {} is not loopback, and without keys (this release has none) anybody who reaches it could \
                 use it; put a proxy that knows its clients in front",
                self.listen
            ));
        }
        for (name, seconds) in
            [("body_idle_s", self.body_idle_s), ("wait_max_s", self.wait_max_s), ("drain_s", self.drain_s)]
        {
            if !(0.0..=86_400.0).contains(&seconds) {
                return Err(format!("server.{name}: {seconds} is not within 0 to 86400"));
            }
        }
        let least_one = [
            ("concurrent_uploads", self.concurrent_uploads == 0),
            ("concurrent_predictions", self.concurrent_predictions == 0),
            ("concurrent_streams", self.concurrent_streams == 0),
            ("predict_windows_max", self.predict_windows_max == 0),
            ("simulate_steps_max", self.simulate_steps_max == 0),
            ("errors_max", self.errors_max == 0),
            ("progress_interval_s", !(0.01..=3600.0).contains(&self.progress_interval_s)),
            ("page_size", self.page_size == 0),
            ("page_size_max", !(1..=100_000).contains(&self.page_size_max)),
        ];
        match least_one.iter().find(|(_, wrong)| *wrong) {
            Some((name, _)) => Err(format!("server.{name}: out of range")),
            None => Ok(()),
        }
    }
}
