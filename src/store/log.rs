//! The write-ahead log, and how long it may become.
//!
//! `SQLite` copies it into the database every 1,000 pages, but begins it anew only when nobody reads what is in it: where
//! readers overlap all the time it would grow for ever. So it is emptied before a change that finds it longer than it may be.
//! Whoever begins to read meanwhile reads the database alone, so that only those who read already are waited for.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};
use sqlx::{Row, SqlitePool, query};

use super::{Store, StoreError, StoreSettings, beside};

#[derive(Debug)]
pub(super) struct Log {
    /// Bytes beyond which it is emptied.
    most_bytes: u64,
    /// Empties it: its one connection waits for readers as long as a change may.
    folder: SqlitePool,
    /// Since when somebody who reads has kept it from being emptied, and whether that was told.
    held: Mutex<Option<Held>>,
}

#[derive(Debug, Clone, Copy)]
struct Held {
    since: Instant,
    told: bool,
}

impl Log {
    pub(super) fn new(settings: &StoreSettings, options: SqliteConnectOptions) -> Self {
        let options = options.busy_timeout(Duration::from_secs_f64(settings.log_wait_s));
        let folder = SqlitePoolOptions::new().max_connections(1).connect_lazy_with(options);
        Self { most_bytes: settings.log_bytes, folder, held: Mutex::default() }
    }

    /// Of a database that is only read.
    pub(super) fn absent(readers: &SqlitePool) -> Self {
        Self { most_bytes: u64::MAX, folder: readers.clone(), held: Mutex::default() }
    }

    pub(super) async fn close(&self) {
        self.folder.close().await;
    }

    fn held(&self) -> MutexGuard<'_, Option<Held>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How long somebody who reads has kept it from being emptied.
    pub(super) fn held_for(&self) -> Duration {
        self.held().map_or(Duration::ZERO, |held| held.since.elapsed())
    }
}

impl Store {
    /// Bytes of the write-ahead log's file.
    pub(super) fn log_bytes(&self) -> u64 {
        std::fs::metadata(beside(&self.path, "-wal")).map_or(0, |found| found.len())
    }

    /// Empties the write-ahead log where it is longer than it may be. A reader that is in the way twice in a row is told of.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn keep_log_short(&self) -> Result<(), StoreError> {
        let bytes = self.log_bytes();
        if bytes <= self.log.most_bytes || self.fold_log().await? {
            let held = self.log.held().take();
            if let Some(Held { since, told: true }) = held {
                tracing::info!(held_s = since.elapsed().as_secs_f64(), "the write-ahead log is short again");
            }
            return Ok(());
        }
        let mut held = self.log.held();
        match &mut *held {
            None => *held = Some(Held { since: Instant::now(), told: false }),
            Some(Held { told: true, .. }) => {}
            Some(Held { told, .. }) => {
                *told = true;
                tracing::warn!(
                    bytes,
                    most_bytes = self.log.most_bytes,
                    "a reader keeps the write-ahead log from being emptied, and it grows: a check, a backup, or another program"
                );
            }
        }
        Ok(())
    }

    /// [`Self::keep_log_short`] before a change, but while a reader is known to be in the way: then upkeep alone tries again,
    /// and no change waits.
    pub(super) async fn keep_log_short_before_a_change(&self) {
        if self.log_bytes() <= self.log.most_bytes || self.log.held().is_some() {
            return;
        }
        if let Err(error) = self.keep_log_short().await {
            // Where that matters, the change itself will find out.
            tracing::debug!(%error, "the write-ahead log could not be emptied");
        }
    }

    /// Writes the write-ahead log into the database and empties it. `false` when a reader did not end within `log_wait_s`.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn fold_log(&self) -> Result<bool, StoreError> {
        // Nobody writes meanwhile.
        let _writer = self.writer.acquire().await?;
        let folded = query("pragma wal_checkpoint(truncate)").fetch_one(&self.log.folder).await?;
        Ok(folded.try_get::<i64, _>("busy")? == 0)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    use sqlx::{Sqlite, Transaction};
    use tokio::sync::watch;

    use super::super::fixture::Fixture;
    use super::*;
    use crate::consolidation::Method;
    use crate::lineage::ModelSettings;

    const MOST_BYTES: u64 = 1 << 20;

    /// How many changes were written.
    type Written = Arc<AtomicU32>;

    async fn opened(log_bytes: u64, log_wait_s: f64) -> Fixture {
        let fixture = Fixture::set(|usual| StoreSettings { log_bytes, log_wait_s, ..usual }).await;
        let model_id = fixture.model("m", Method::Naive, &ModelSettings::default()).await;
        fixture.batch(model_id, "fast", 0..30).await;
        fixture
    }

    /// A reader in the midst of what was written by now.
    async fn reading(store: &Store) -> Transaction<'static, Sqlite> {
        let mut reading = store.readers.begin().await.unwrap();
        query("select count(*) from event").fetch_one(&mut *reading).await.unwrap();
        reading
    }

    /// Changes about 120 KB.
    async fn change(fixture: &Fixture) {
        fixture.execute("update event set arrays = randomblob(4000)").await;
    }

    /// Reads until something was written, or for long, and then on until `other` has begun anew: again and again.
    async fn read_on(store: Arc<Store>, begun: watch::Sender<u32>, mut other: watch::Receiver<u32>, written: Written) {
        loop {
            let mut reading = reading(&store).await;
            let before = written.load(Ordering::Relaxed);
            begun.send_modify(|begun| *begun += 1);
            for _ in 0..300 {
                if written.load(Ordering::Relaxed) > before {
                    break;
                }
                query("select count(*) from event").fetch_one(&mut *reading).await.unwrap();
            }
            if other.changed().await.is_err() {
                return;
            }
        }
    }

    /// The longest that the log became while something was written and two read all the time, each in what is older.
    async fn longest_with_constant_readers(fixture: &Fixture) -> u64 {
        let (ours, theirs, written) = (watch::channel(0), watch::channel(0), Written::default());
        let reader =
            |begun, other| tokio::spawn(read_on(Arc::clone(&fixture.store), begun, other, Arc::clone(&written)));
        let readers = [reader(ours.0, theirs.1), reader(theirs.0, ours.1)];
        let mut longest = 0;
        for _ in 0..60 {
            change(fixture).await;
            written.fetch_add(1, Ordering::Relaxed);
            longest = longest.max(fixture.store.log_bytes());
        }
        assert!(readers.iter().all(|reader| !reader.is_finished()));
        for reader in readers {
            reader.abort();
        }
        longest
    }

    #[tokio::test]
    async fn the_log_stays_short_though_somebody_reads_all_the_time() {
        let fixture = opened(MOST_BYTES, 5.0).await;
        assert!(fixture.store.fold_log().await.unwrap());
        change(&fixture).await;
        let one_change = fixture.store.log_bytes();
        let longest = longest_with_constant_readers(&fixture).await;
        assert!(longest <= MOST_BYTES + 2 * one_change, "{longest} bytes, and {one_change} for one change");
        assert_eq!(fixture.store.size().await.unwrap().log_held, Duration::ZERO);
    }

    #[tokio::test]
    async fn a_log_without_a_bound_grows_under_constant_readers() {
        // Otherwise the test above could not fail.
        let fixture = opened(u64::MAX, 5.0).await;
        let longest = longest_with_constant_readers(&fixture).await;
        assert!(longest > 5 * MOST_BYTES, "{longest} bytes");
    }

    #[tokio::test]
    async fn a_reader_that_does_not_end_is_known_and_stops_no_change() {
        let fixture = opened(MOST_BYTES, 0.0).await;
        let stuck = reading(&fixture.store).await;
        for _ in 0..30 {
            change(&fixture).await;
        }
        assert!(fixture.store.log_bytes() > 2 * MOST_BYTES);
        assert!(fixture.store.size().await.unwrap().log_held > Duration::ZERO);
        let told = || fixture.store.log.held().unwrap().told;
        assert!(!told(), "a change tries once");
        fixture.store.keep_log_short().await.unwrap();
        assert!(told());
        drop(stuck);
        while fixture.store.log_bytes() > 0 {
            fixture.store.keep_log_short().await.unwrap();
        }
        assert_eq!(fixture.store.size().await.unwrap().log_held, Duration::ZERO);
    }
}
