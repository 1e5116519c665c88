//! Settings of the database.

use std::ops::RangeInclusive;
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
    /// Bytes beyond which the write-ahead log is emptied before the next change.
    pub log_bytes: u64,
    /// How long that waits for whoever reads, s.
    pub log_wait_s: f64,
    /// Prepared statements kept per connection.
    pub statement_cache: usize,
    /// Entries of the audit log that are kept.
    pub audit_entries: u32,
    /// Versions found corrupt that are remembered as such until the server stops.
    pub corrupt_versions: usize,
    /// Whether a database of an earlier schema is copied, beside itself, before it is changed.
    pub backup_before_migration: bool,
}

impl StoreSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 8] {
        [
            ("readers", self.readers.into(), 1.0..=256.0),
            ("busy_timeout_s", self.busy_timeout_s, 0.0..=3600.0),
            ("writer_wait_s", self.writer_wait_s, 0.01..=86_400.0),
            ("log_bytes", self.log_bytes as f64, 65_536.0..=1e15),
            ("log_wait_s", self.log_wait_s, 0.0..=60.0),
            ("statement_cache", self.statement_cache as f64, 1.0..=100_000.0),
            ("audit_entries", self.audit_entries.into(), 1000.0..=1e9),
            ("corrupt_versions", self.corrupt_versions as f64, 1.0..=1e6),
        ]
    }
}
