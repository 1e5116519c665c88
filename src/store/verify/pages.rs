//! What `SQLite` itself can tell of its file.

use sqlx::sqlite::SqliteConnection;
use sqlx::{Row, query};

use super::{Findings, count};
use crate::store::StoreError;

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
