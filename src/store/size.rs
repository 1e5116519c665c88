//! How large the database is, and giving back what it does not use.

use std::time::Duration;

use sqlx::{AssertSqlSafe, query};

use super::column::count;
use super::{Store, StoreError};

/// What it takes of the disk; bytes, where nothing else is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DatabaseSize {
    /// Of the database's file.
    pub database: u64,
    /// Of its write-ahead log.
    pub log: u64,
    /// Of pages in the file that nothing uses.
    pub unused: u64,
    /// How long somebody who reads has kept the log from being emptied; zero when nobody does, or it is short.
    pub log_held: Duration,
}

/// Pages of the file, those in the write-ahead log included.
struct Pages {
    /// Bytes of one.
    size: u64,
    all: u64,
    /// Those that nothing uses.
    unused: u64,
}

impl Store {
    /// How large it is.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn size(&self) -> Result<DatabaseSize, StoreError> {
        let database = std::fs::metadata(&self.path).map_or(0, |found| found.len());
        let Pages { size, unused, .. } = self.pages().await?;
        Ok(DatabaseSize { database, log: self.log_bytes(), unused: unused * size, log_held: self.log.held_for() })
    }

    /// Pages of the file that nothing uses.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn unused_pages(&self) -> Result<u64, StoreError> {
        Ok(self.pages().await?.unused)
    }

    /// Bytes of pages that something uses, those in the write-ahead log included.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn used_bytes(&self) -> Result<u64, StoreError> {
        let Pages { size, all, unused } = self.pages().await?;
        Ok((all - unused) * size)
    }

    async fn pages(&self) -> Result<Pages, StoreError> {
        let row = query(
            "select page_size, page_count, freelist_count
             from pragma_page_size, pragma_page_count, pragma_freelist_count",
        )
        .fetch_one(&self.readers)
        .await?;
        Ok(Pages {
            size: count(&row, "page_size")?,
            all: count(&row, "page_count")?,
            unused: count(&row, "freelist_count")?,
        })
    }

    /// Gives up to `pages` unused pages at the end of the file back to the file system. `false` where the file does not
    /// let go of pages one by one, as those that earlier releases made: [`Self::compact`] changes that.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn give_back(&self, pages: u32) -> Result<bool, StoreError> {
        let before = self.unused_pages().await?;
        query(AssertSqlSafe(format!("pragma incremental_vacuum({pages})"))).fetch_all(&self.writer).await?;
        Ok(self.unused_pages().await? < before)
    }

    /// Writes the whole database anew, without what it does not use, and so that it lets go of pages one by one from then
    /// on. Takes as much room again while it lasts, and nobody else writes meanwhile.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn compact(&self) -> Result<(), StoreError> {
        let mut writer = self.writer.acquire().await?;
        query("pragma auto_vacuum = incremental").execute(&mut *writer).await?;
        query("vacuum").execute(&mut *writer).await?;
        query("pragma wal_checkpoint(truncate)").fetch_all(&mut *writer).await?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use sqlx::ConnectOptions as _;
    use sqlx::sqlite::SqliteConnectOptions;

    use super::super::fixture::Fixture;
    use super::*;
    use crate::consolidation::Method;
    use crate::lineage::ModelSettings;

    /// Whether pages are given back after many events went.
    async fn gives_back(fixture: &Fixture) -> bool {
        fixture.execute("update event set arrays = zeroblob(20000)").await;
        fixture.execute("update event set arrays = x''").await;
        assert!(fixture.store.unused_pages().await.unwrap() > 100);
        fixture.store.give_back(50).await.unwrap()
    }

    async fn with_events(fixture: &Fixture) {
        let model_id = fixture.model("m", Method::Naive, &ModelSettings::default()).await;
        fixture.batch(model_id, "fast", 0..60).await;
    }

    #[tokio::test]
    async fn a_new_database_gives_back_so_many_pages_at_once() {
        let fixture = Fixture::new().await;
        with_events(&fixture).await;
        assert!(gives_back(&fixture).await);
        let before = fixture.store.unused_pages().await.unwrap();
        fixture.store.give_back(7).await.unwrap();
        assert_eq!(before - fixture.store.unused_pages().await.unwrap(), 7);
    }

    #[tokio::test]
    async fn a_database_that_gives_no_page_back_does_once_it_is_compacted() {
        let directory = tempfile::tempdir().unwrap();
        let options = SqliteConnectOptions::new().filename(directory.path().join("headway.db")).create_if_missing(true);
        let mut connection = options.connect().await.unwrap();
        query("create table older (a)").execute(&mut connection).await.unwrap();
        query("drop table older").execute(&mut connection).await.unwrap();
        drop(connection);
        let fixture = Fixture::within(directory).await;
        with_events(&fixture).await;
        assert!(!gives_back(&fixture).await);
        assert!(fixture.store.fold_log().await.unwrap());
        let before = fixture.store.size().await.unwrap();
        fixture.store.compact().await.unwrap();
        let after = fixture.store.size().await.unwrap();
        assert!(after.database < before.database && after.unused == 0 && after.log == 0, "{before:?} {after:?}");
        assert!(gives_back(&fixture).await);
    }
}
