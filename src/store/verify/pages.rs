//! What `SQLite` itself can tell of its file, and whether its tables are those of its schema.

use std::collections::BTreeMap;

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions, Connection, Row, query};

use super::{Findings, count};
use crate::store::{StoreError, schema};

/// Tables, indexes and triggers as they were defined, by name; but `SQLite`'s own and those of the migrations' list.
async fn definitions(connection: &mut SqliteConnection) -> Result<BTreeMap<String, String>, StoreError> {
    let rows = query(
        "select name, type || ' on ' || tbl_name || ': ' || sql as definition from sqlite_schema
         where sql is not null and name not like 'sqlite_%' and name not like '_sqlx_%'",
    );
    let rows = rows.fetch_all(connection).await?;
    rows.iter().map(|row| Ok((row.try_get("name")?, row.try_get("definition")?))).collect()
}

/// That nothing the schema defines is missing or other than its migrations make it. What others have added is theirs.
pub(super) async fn definitions_are(
    connection: &mut SqliteConnection,
    schema: i64,
    findings: &mut Findings<'_>,
) -> Result<(), StoreError> {
    findings.begin("definitions", 0);
    let mut made = SqliteConnectOptions::new().in_memory(true).disable_statement_logging().connect().await?;
    schema::make(&mut made, schema).await?;
    let expected = definitions(&mut made).await?;
    made.close().await?;
    let found = definitions(connection).await?;
    for (name, definition) in &expected {
        findings.looked();
        match found.get(name) {
            None => findings.fault(name, "is not there"),
            Some(found) if found != definition => findings.fault(name, "is not what its schema makes it"),
            Some(_) => {}
        }
    }
    Ok(())
}

/// Every page, and that every index agrees with its table.
pub(super) async fn pages(connection: &mut SqliteConnection, findings: &mut Findings<'_>) -> Result<(), StoreError> {
    findings.begin("pages", 0);
    let pages = count(connection, "select page_count from pragma_page_count").await;
    findings.of = *pages.as_ref().unwrap_or(&0);
    findings.tell();
    // A damaged page may end the look in the middle; what was told until then stays.
    let rows = query("pragma integrity_check(1000)").fetch_all(&mut *connection).await?;
    findings.looked_at = pages?;
    for row in rows {
        let said: String = row.try_get(0)?;
        if said != "ok" {
            findings.fault("the database file", said);
        }
    }
    Ok(())
}

/// Every reference from one row to another.
pub(super) async fn references(
    connection: &mut SqliteConnection,
    findings: &mut Findings<'_>,
) -> Result<(), StoreError> {
    findings.begin("references", 0);
    let tables = "select count(*) from pragma_table_list t, pragma_foreign_key_list(t.name)";
    findings.looked_at = count(connection, tables).await?;
    let rows = query("pragma foreign_key_check").fetch_all(&mut *connection).await?;
    for row in rows {
        let (table, parent): (String, String) = (row.try_get("table")?, row.try_get("parent")?);
        let place = match row.try_get::<Option<i64>, _>("rowid")? {
            Some(rowid) => format!("{table}, row {rowid}"),
            None => table,
        };
        findings.fault(place, format!("refers to a {parent} that is not there"));
    }
    Ok(())
}
