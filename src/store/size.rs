//! How large the database is, and giving back what it does not use.

use sqlx::{AssertSqlSafe, Row, query};

use super::{Store, StoreError};

/// Bytes on the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DatabaseSize {
    /// Of the database's file.
    pub database: u64,
    /// Of its write-ahead log.
    pub log: u64,
    /// Of pages in the file that nothing uses.
    pub unused: u64,
}

impl Store {
    /// How large it is.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn size(&self) -> Result<DatabaseSize, StoreError> {
        let bytes = |path: &std::path::Path| std::fs::metadata(path).map_or(0, |found| found.len());
        let mut log = self.path.clone().into_os_string();
        log.push("-wal");
        let row = query("pragma page_size").fetch_one(&self.readers).await?;
        let page: i64 = row.try_get("page_size")?;
        let unused = self.unused_pages().await? * page.unsigned_abs();
        Ok(DatabaseSize { database: bytes(&self.path), log: bytes(log.as_ref()), unused })
    }

    /// Pages of the file that nothing uses.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn unused_pages(&self) -> Result<u64, StoreError> {
        let row = query("pragma freelist_count").fetch_one(&self.readers).await?;
        Ok(row.try_get::<i64, _>("freelist_count")?.unsigned_abs())
    }

    /// Bytes of pages that something uses, those in the write-ahead log included.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub async fn used_bytes(&self) -> Result<u64, StoreError> {
        let mut reader = self.readers.acquire().await?;
        let pages: i64 = query("pragma page_count").fetch_one(&mut *reader).await?.try_get("page_count")?;
        let page: i64 = query("pragma page_size").fetch_one(&mut *reader).await?.try_get("page_size")?;
        let unused: i64 = query("pragma freelist_count").fetch_one(&mut *reader).await?.try_get("freelist_count")?;
        Ok((pages - unused).unsigned_abs() * page.unsigned_abs())
    }

    /// Gives up to `pages` unused pages at the end of the file back to the file system. `false` where the file does not
    /// let go of pages one by one, as those that releases before 0.2 made: [`Self::compact`] changes that.
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
