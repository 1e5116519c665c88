//! Settings of the database.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Where the database is and how it is opened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoreSettings {
    /// The file.
    pub path: PathBuf,
    /// Connections that read.
    pub readers: u32,
    /// How long a connection waits for a lock, s.
    pub busy_timeout_s: f64,
    /// How long a change waits for the one connection that writes, s.
    pub writer_wait_s: f64,
    /// Prepared statements kept per connection.
    pub statement_cache: usize,
}
