//! What can go wrong with the database.

use std::path::PathBuf;

use super::verify::Verification;

/// What is stored with a digest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A model's method and settings.
    Model,
    /// A version's row, its evaluation or its weights.
    Version,
    /// What consolidation keeps of a regime.
    Anchor,
    /// The test events of a regime.
    Reservoir,
    /// An event's arrays.
    Event,
    /// Where a task goes on.
    Checkpoint,
}

impl Part {
    /// The code a task fails with when it needs this and it is corrupt.
    #[must_use]
    pub fn code(self) -> &'static str {
        match self {
            Self::Model => "corrupt_model",
            Self::Version => "corrupt_version",
            Self::Anchor => "corrupt_anchor",
            Self::Reservoir => "corrupt_reservoir",
            Self::Event => "corrupt_event",
            Self::Checkpoint => "corrupt_checkpoint",
        }
    }
}

/// Why the store could not do as it was told. Conflicts in the words of the service are results, not errors of this kind.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// Another process holds the lock.
    #[error("{} belongs to another running headway; stop it, or use --server URL to talk to it", path.display())]
    Owned {
        /// The database.
        path: PathBuf,
    },
    /// There is no such file.
    #[error("there is no {}", path.display())]
    Absent {
        /// The file.
        path: PathBuf,
    },
    /// The file is a database of something else.
    #[error("{} is no database of Headway", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// The database was made by a newer release.
    #[error(
        "the database has schema {schema}, and this release knows none beyond {newest}: use the release that made it, or \
         restore the backup that was taken before its schema changed (PATH.schema-N.….backup beside it)"
    )]
    Newer {
        /// The database's.
        schema: i64,
        /// The newest this release knows.
        newest: i64,
    },
    /// A copy would take the place of a file.
    #[error("{} exists; --force takes its place", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// A copy could not be written.
    #[error("cannot write {}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// What was to be kept or put back is not what was written.
    #[error("it is not sound, {} faults: {}", .0.faults_in_all(), first(.0))]
    Unsound(Box<Verification>),
    /// The lock file could not be used.
    #[error("cannot lock {}: {source}", path.display())]
    Lock {
        /// The database.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A migration failed.
    #[error("cannot bring the database to this release's schema: {0}")]
    Migrate(#[from] sqlx::migrate::MigrateError),
    /// The writer was taken for too long, by this process or another.
    #[error("other changes of the database took longer than database.writer_wait_s or busy_timeout_s")]
    Busy,
    /// Nothing more can be written: the disk is full, or a limit on what this process may write is reached.
    #[error("the database cannot grow: {0}")]
    Full(sqlx::Error),
    /// The database cannot be written at all.
    #[error("the database is read-only: {0}")]
    ReadOnly(sqlx::Error),
    /// `SQLite` said no.
    #[error("database: {0}")]
    Sql(sqlx::Error),
    /// `SQLite` found a page that cannot be, or no database at all.
    #[error(
        "the database file is damaged ({0}); stop the server, let `headway verify` say how far, and put a backup in its \
         place with `headway restore`"
    )]
    Damaged(sqlx::Error),
    /// Changes that were acknowledged come after what is damaged in the write-ahead log.
    #[error(
        "{} is damaged at frame {frame}, and acknowledged changes that come after it would be lost: put a backup in the \
         database's place with `headway restore`; any other program that opens it drops them for good",
        path.display()
    )]
    DamagedLog {
        /// The log.
        path: PathBuf,
        /// The first frame that is not what was written, from 1; 0 is the log's header.
        frame: u64,
    },
    /// The file of a database that was made once is empty.
    #[error(
        "{0} is empty, and a database was there before; restore it from a backup (headway restore), or remove it to begin with \
         an empty one"
    )]
    Emptied(PathBuf),
    /// Something stored is not what was written: its digest does not match.
    #[error("{detail}")]
    Corrupt {
        /// What.
        part: Part,
        /// Which, and what can be done.
        detail: String,
    },
    /// A stored value is not what this release writes.
    #[error("database holds a malformed {what}: {detail}")]
    Malformed {
        /// Which value.
        what: &'static str,
        /// What is wrong with it.
        detail: String,
    },
}

fn first(found: &Verification) -> String {
    let told = found.faults.first();
    told.map(|fault| format!("{}: {}: {}", fault.check, fault.place, fault.detail)).unwrap_or_default()
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        if matches!(error, sqlx::Error::PoolTimedOut) {
            return Self::Busy;
        }
        match result_code(&error) {
            Some(BUSY) => Self::Busy,
            Some(READONLY) => Self::ReadOnly(error),
            Some(FULL | IOERR_WRITE | IOERR_TRUNCATE | IOERR_SHMSIZE) => Self::Full(error),
            Some(CORRUPT | NOTADB) => Self::Damaged(error),
            _ => Self::Sql(error),
        }
    }
}

// <https://sqlite.org/rescode.html>
const BUSY: i32 = 5;
const READONLY: i32 = 8;
const IOERR: i32 = 10;
const CORRUPT: i32 = 11;
const FULL: i32 = 13;
const NOTADB: i32 = 26;
const IOERR_WRITE: i32 = IOERR | (3 << 8);
const IOERR_TRUNCATE: i32 = IOERR | (6 << 8);
const IOERR_SHMSIZE: i32 = IOERR | (19 << 8);

/// The result code of `SQLite`: of failed input and output the extended one, else the primary one, its last byte.
fn result_code(error: &sqlx::Error) -> Option<i32> {
    let code: i32 = error.as_database_error()?.code()?.parse().ok()?;
    Some(if code & 0xff == IOERR { code } else { code & 0xff })
}

impl StoreError {
    /// Whether the same may succeed later: nothing is wrong with what was to be read or written.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        matches!(self, Self::Busy | Self::Full(_) | Self::ReadOnly(_))
    }

    /// A stored `what` that cannot be read back.
    #[expect(clippy::needless_pass_by_value, reason = "callers hand over an error they are done with")]
    pub(crate) fn malformed(what: &'static str, detail: impl ToString) -> Self {
        Self::Malformed { what, detail: detail.to_string() }
    }

    /// A stored `part` that is not what was written.
    pub(crate) fn corrupt(part: Part, detail: impl Into<String>) -> Self {
        Self::Corrupt { part, detail: detail.into() }
    }
}
