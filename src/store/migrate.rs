//! Bringing a database to the newest schema.

use std::path::{Path, PathBuf};

use jiff::Timestamp;
use sqlx::SqlitePool;
use sqlx::migrate::Migrate;

use super::schema::{APPLIED, MIGRATIONS, applied, newest, refuse_newer};
use super::{StoreError, backup, beside};

/// Brings the database at `path` to the newest schema; one with data in it is backed up beside itself first, unless
/// `keep_backup` says otherwise. Gives the backup's path when one was taken.
///
/// # Errors
/// When the database is newer than this release, it cannot be changed, or the backup cannot be written: then nothing is
/// changed.
pub(super) async fn migrate(
    writer: &SqlitePool,
    path: &Path,
    keep_backup: bool,
) -> Result<Option<PathBuf>, StoreError> {
    let mut connection = writer.acquire().await?;
    connection.ensure_migrations_table(APPLIED).await?;
    let applied = applied(&mut connection).await?;
    drop(connection);
    let schema = applied.last().copied().unwrap_or(0);
    refuse_newer(schema)?;
    let is_current = MIGRATIONS.iter().all(|migration| applied.contains(&migration.version));
    let taken = if schema > 0 && !is_current && keep_backup {
        // The name tells which release can read it.
        let to = beside(path, &format!(".schema-{schema}.{}.backup", Timestamp::now().strftime(backup::NAMED)));
        backup::write(path, &to, false).await?;
        tracing::info!(schema, newest = newest(), backup = %to.display(), "a backup was taken before the schema changes");
        Some(to)
    } else {
        None
    };
    MIGRATIONS.run(writer).await?;
    Ok(taken)
}
