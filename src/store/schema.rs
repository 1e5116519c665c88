//! Which schema a database has, and which there are.

use std::collections::BTreeSet;
use std::path::Path;

use sqlx::migrate::{Migrate, Migrator};
use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query, raw_sql};

use super::StoreError;

/// Every migration of this release, in order.
pub(super) static MIGRATIONS: Migrator = sqlx::migrate!("./migrations");

/// Where the migrations that were applied are written down.
pub(super) const APPLIED: &str = "_sqlx_migrations";

/// The newest schema this release knows.
pub(super) fn newest() -> i64 {
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

/// The migrations that were applied.
pub(super) async fn applied(connection: &mut SqliteConnection) -> Result<BTreeSet<i64>, StoreError> {
    let applied = connection.list_applied_migrations(APPLIED).await?;
    Ok(applied.iter().map(|migration| migration.version).collect())
}

/// Refuses a schema that only a newer release knows.
pub(super) fn refuse_newer(schema: i64) -> Result<(), StoreError> {
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

/// Makes an empty database of the newest schema that says so; when it was made is nothing that it tells.
///
/// # Errors
/// When it cannot be written.
pub(super) async fn make_newest(connection: &mut SqliteConnection) -> Result<(), StoreError> {
    connection.ensure_migrations_table(APPLIED).await?;
    make(connection, newest()).await?;
    for migration in MIGRATIONS.iter() {
        query(
            "insert into _sqlx_migrations (version, description, installed_on, success, checksum, execution_time)
             values (?, ?, '1970-01-01 00:00:00', true, ?, 0)",
        )
        .bind(migration.version)
        .bind(&*migration.description)
        .bind(&*migration.checksum)
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}
