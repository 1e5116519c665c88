//! Which schema a database has, and what comes before a change of it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use sqlx::migrate::{Migrate, Migrator};
use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, SqlitePool, query, raw_sql};

use super::{StoreError, backup, beside};

/// Every migration of this release, in order.
pub(super) static MIGRATIONS: Migrator = sqlx::migrate!("./migrations");

/// Where the migrations that were applied are written down.
const APPLIED: &str = "_sqlx_migrations";

/// The newest schema this release knows.
fn newest() -> i64 {
    MIGRATIONS.iter().map(|migration| migration.version).max().unwrap_or(0)
}

/// The schema of a database that is there.
///
/// # Errors
/// When it has none of Headway's, or one of a newer release, or cannot be read.
pub(super) async fn read(connection: &mut SqliteConnection, path: &Path) -> Result<i64, StoreError> {
    let row =
        query("select count(*) from sqlite_schema where name = '_sqlx_migrations'").fetch_one(&mut *connection).await?;
    if row.try_get::<i64, _>(0)? == 0 {
        return Err(StoreError::Foreign { path: path.to_owned() });
    }
    let schema = applied(connection).await?.last().copied().unwrap_or(0);
    refuse_newer(schema)?;
    Ok(schema)
}

async fn applied(connection: &mut SqliteConnection) -> Result<BTreeSet<i64>, StoreError> {
    let applied = connection.list_applied_migrations(APPLIED).await?;
    Ok(applied.iter().map(|migration| migration.version).collect())
}

fn refuse_newer(schema: i64) -> Result<(), StoreError> {
    let newest = newest();
    if schema > newest { Err(StoreError::Newer { schema, newest }) } else { Ok(()) }
}

/// Makes an empty database of this schema.
///
/// # Errors
/// When it cannot be written.
pub(super) async fn make(connection: &mut SqliteConnection, schema: i64) -> Result<(), StoreError> {
    for migration in MIGRATIONS.iter().filter(|migration| migration.version <= schema) {
        raw_sql(migration.sql.clone()).execute(&mut *connection).await?;
    }
    Ok(())
}

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
