//! The only home of SQL. One file per resource; the rest of the code speaks to it in the words of `lineage`.
//!
//! One connection writes, always inside `BEGIN IMMEDIATE` (a deferred read-then-write fails at once when another writer
//! got in between, and ignores the busy timeout); a pool of read-only connections reads.

/// Who did what.
pub mod audit;
/// Copies of a database, and putting them back.
pub mod backup;
/// Batches: beginning, ending and reading them.
pub mod batch;
/// What batches hold.
pub mod contents;
/// Arrays of numbers.
pub mod array;
mod census;
mod checkpoint;
mod column;
/// Forks and archives: a model's rows, copied.
pub mod copy;
mod damage;
/// Content that goes for good.
pub mod erase;
mod error;
/// Events: storing each content once.
pub mod event;
#[cfg(test)]
pub(crate) mod fixture;
mod frames;
/// Who served when and why.
pub mod history;
/// Answers that are given again.
pub mod idempotency;
/// Keys: making, listing, revoking.
pub mod keys;
/// Versions from elsewhere.
pub mod import;
mod kept;
mod ledger;
mod line;
/// Promote and rollback.
pub mod live;
/// One process owns a database.
mod lock;
mod log;
/// Bringing a database to the newest schema.
mod migrate;
/// Models: creating, reading, pausing.
pub mod model;
/// The rows of a version that is written.
pub mod new_version;
/// How a task ends.
pub mod outcome;
mod pointers;
mod prune;
/// Events that were refused.
pub mod rejection;
/// The end of a replay.
pub mod replay;
/// Retracting a batch.
pub mod retract;
mod schema;
mod seal;
/// From waiting events to tasks.
pub mod selection;
mod settings;
mod size;
/// Where events come from, and what of it is held.
pub mod source;
mod taint;
/// Tasks: reading, starting, cancelling.
pub mod task;
mod transaction;
/// Whether a database is what was written.
pub mod verify;
/// Versions and their notes.
pub mod version;

use std::path::{Path, PathBuf};

use sqlx::sqlite::{SqliteAutoVacuum, SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection, SqliteConnection, SqlitePool};

pub use audit::Actor;
pub use census::ModelCensus;
pub use error::{Part, StoreError};
pub use ledger::LedgerEvent;
pub use line::LineRegime;
use lock::Lock;
pub use settings::StoreSettings;
pub use size::DatabaseSize;
pub use transaction::{Purpose, WriteTransaction};

/// The database of one server.
#[derive(Debug)]
pub struct Store {
    writer: SqlitePool,
    readers: SqlitePool,
    damage: damage::Damage,
    path: PathBuf,
    log: log::Log,
    /// None where the database is only read.
    lock: Option<Lock>,
}

impl Store {
    /// Opens, locks and migrates the database at `settings.path`, creating it when it is absent.
    ///
    /// # Errors
    /// When another process owns it, it cannot be written, it was made by a newer release, it was there before and is empty
    /// now, or its write-ahead log is damaged where changes would be lost.
    pub async fn open(settings: &StoreSettings) -> Result<Self, StoreError> {
        let lock = Lock::take(&settings.path)?;
        lock.refuse_emptied(&settings.path)?;
        let log = beside(&settings.path, "-wal");
        // A log that cannot be read is SQLite's to complain of.
        if let Ok(Some(frame)) = frames::first_damaged(&log) {
            return Err(StoreError::DamagedLog { path: log, frame });
        }
        let options = SqliteConnectOptions::new()
            .filename(&settings.path)
            // What is erased is written over, wherever a page held it.
            .pragma("secure_delete", "on")
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(std::time::Duration::from_secs_f64(settings.busy_timeout_s))
            .statement_cache_capacity(settings.statement_cache);
        // What the writer notes changes with is of this release's tables, so these are made first.
        let first = SqlitePoolOptions::new().max_connections(1);
        // Takes effect when the database is made: pages that nothing uses can be given back one by one.
        let making = options.clone().create_if_missing(true).auto_vacuum(SqliteAutoVacuum::Incremental);
        let first = first.connect_with(making).await?;
        migrate::migrate(&first, &settings.path, settings.backup_before_migration).await?;
        first.close().await;
        lock.note_made();
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            .after_release(|connection, _| Box::pin(is_outside_transactions(connection)))
            .acquire_timeout(std::time::Duration::from_secs_f64(settings.writer_wait_s))
            .after_connect(|connection, _| Box::pin(audit::prepare(connection)))
            .connect_with(options.clone())
            .await?;
        let log = log::Log::new(settings, options.clone());
        let readers = SqlitePoolOptions::new()
            .max_connections(settings.readers)
            .connect_with(options.pragma("query_only", "on"))
            .await?;
        let store = Self {
            writer,
            readers,
            path: settings.path.clone(),
            log,
            damage: damage::Damage::new(settings.corrupt_versions),
            lock: Some(lock),
        };
        let mut transaction = store.begin().await?;
        seal::seal(&mut transaction).await?;
        audit::bound(&mut transaction, settings.audit_entries).await?;
        transaction.commit().await?;
        Ok(store)
    }

    /// Opens a database that is there to read only, whoever owns it.
    ///
    /// # Errors
    /// When there is none, it is none of Headway's or newer than this release, or it cannot be read.
    pub async fn open_to_read(path: &Path) -> Result<Self, StoreError> {
        let mut connection = verify::open(path).await?;
        schema::read(&mut connection, path).await?;
        connection.close().await?;
        let options = SqliteConnectOptions::new().filename(path).read_only(true);
        let readers = SqlitePoolOptions::new().max_connections(2).connect_with(options).await?;
        // Who only reads, reports what he finds himself.
        let damage = damage::Damage::new(0);
        let log = log::Log::absent(&readers);
        let (writer, path) = (readers.clone(), path.to_owned());
        Ok(Self { writer, readers, damage, path, log, lock: None })
    }

    /// The database's file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits for the writer and begins a write transaction of the server's own.
    ///
    /// # Errors
    /// When the database cannot be written, or other changes take longer than `writer_wait_s`.
    pub async fn begin(&self) -> Result<WriteTransaction, StoreError> {
        self.begin_for(&Actor::server()).await
    }

    /// Waits for the writer and begins a write transaction in the name of `actor`.
    ///
    /// # Errors
    /// When the database cannot be written, or other changes take longer than `writer_wait_s`.
    pub async fn begin_for(&self, actor: &Actor) -> Result<WriteTransaction, StoreError> {
        self.keep_log_short_before_a_change().await;
        let mut transaction = WriteTransaction::new(self.writer.begin_with("begin immediate").await?, &actor.name);
        audit::act(&mut transaction, actor).await?;
        Ok(transaction)
    }

    /// Whether the database can be written: takes the lock that every change takes, and changes nothing. While somebody else
    /// makes a change he has it, which is answer enough; he may take long, and nobody is to wait for that.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn look_at_writer(&self) -> Result<(), StoreError> {
        if self.writer.num_idle() == 0 && self.writer.size() > 0 && !self.writer.is_closed() {
            return Ok(());
        }
        // Dropped, it never happened.
        self.begin().await.map(drop)
    }

    /// Closes every connection; the write-ahead log is folded back into the database, which another process may own from then
    /// on, whoever still holds this store.
    pub async fn close(&self) {
        self.readers.close().await;
        self.log.close().await;
        self.writer.close().await;
        if let Some(lock) = &self.lock {
            lock.release();
        }
    }
}

/// Whether a connection that comes back can be used again. Where the disk is full, `SQLite` takes a transaction back by itself,
/// sqlx goes on counting it, and no other could ever begin.
async fn is_outside_transactions(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
    // Behind what else it has to do, a rollback above all.
    connection.ping().await?;
    Ok(!connection.is_in_transaction())
}

/// A file beside a database: its path, and this behind it.
fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_change_waits_for_the_writer_and_is_told_when_that_takes_too_long() {
        let directory = tempfile::tempdir().unwrap();
        let settings = StoreSettings { writer_wait_s: 0.5, ..fixture::settings(&directory) };
        let store = Store::open(&settings).await.unwrap();
        let writing = store.begin().await.unwrap();
        assert!(matches!(store.begin().await, Err(StoreError::Busy)));
        store.look_at_writer().await.unwrap();
        drop(writing);
        store.begin().await.unwrap();
        store.look_at_writer().await.unwrap();
        store.close().await;
        store.look_at_writer().await.unwrap_err();
    }

    #[tokio::test]
    async fn a_database_that_was_emptied_is_not_taken_for_a_new_one() {
        let directory = tempfile::tempdir().unwrap();
        let settings = fixture::settings(&directory);
        let copy = directory.path().join("copy.db");
        let empty = || std::fs::write(&settings.path, "").unwrap();
        let refused =
            async || matches!(Store::open(&settings).await, Err(StoreError::Emptied(path)) if path == settings.path);
        // What a process leaves that was killed before it had made anything.
        empty();
        Store::open(&settings).await.unwrap().close().await;
        backup::write(&settings.path, &copy, false).await.unwrap();
        empty();
        assert!(refused().await);
        backup::restore(&copy, &settings.path, false, &|_| {}).await.unwrap();
        Store::open(&settings).await.unwrap().close().await;
        empty();
        assert!(refused().await);
        std::fs::remove_file(&settings.path).unwrap();
        Store::open(&settings).await.unwrap().close().await;
    }
}
