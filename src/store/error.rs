//! What can go wrong with the database.

use std::path::PathBuf;

/// Why the store could not do as it was told. Conflicts in the words of the service are results, not errors of this kind.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// Another process holds the lock.
    #[error("{} belongs to another running headway; stop it, or use --server URL to talk to it", path.display())]
    Owned {
        /// The database.
        path: PathBuf,
    },
    /// The lock file could not be used.
    #[error("cannot lock {}: {source}", path.display())]
    Lock {
        /// The database.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A migration failed, or the database is newer than this program.
    #[error("cannot bring the database to this release's schema: {0}")]
    Migrate(#[from] sqlx::migrate::MigrateError),
    /// The writer was taken for too long, by this process or another.
    #[error("other changes of the database took longer than database.writer_wait_s or busy_timeout_s")]
    Busy,
    /// `SQLite` said no.
    #[error("database: {0}")]
    Sql(#[from] sqlx::Error),
    /// A stored value is not what this release writes.
    #[error("database holds a malformed {what}: {detail}")]
    Malformed {
        /// Which value.
        what: &'static str,
        /// What is wrong with it.
        detail: String,
    },
}

impl StoreError {
    /// A stored `what` that cannot be read back.
    #[expect(clippy::needless_pass_by_value, reason = "callers hand over an error they are done with")]
    pub(crate) fn malformed(what: &'static str, detail: impl ToString) -> Self {
        Self::Malformed { what, detail: detail.to_string() }
    }
}
