//! One way of copying a model's rows, from a database into itself or into another: forks, archives, what is taken in from
//! them. Numbers of versions, digests and content stay; ids of rows are new, and so are the seals over them, written once the
//! old ones were looked at.

/// A model in a file of its own, and back.
mod archive;
/// Which rows.
mod choose;
/// A file that somebody sent.
mod examine;
mod fork;
/// What is copied is what was written.
mod intact;
/// Row by row, under new ids.
mod rows;

use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::{AssertSqlSafe, Row, query, raw_sql};

pub use archive::{Archive, archive, note};
pub use fork::{Fork, ForkRefused};

use super::{StoreError, seal};
use crate::lineage::ModelName;

/// What an archive is.
pub const MEDIA_TYPE: &str = "application/vnd.sqlite3";

/// What is copied of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Chosen {
    /// Everything.
    All,
    /// What the line of this version learned and came to, and nothing else.
    Line(i64),
}

impl Chosen {
    fn is_all(self) -> bool {
        self == Self::All
    }
}

/// The row of the model that a copy makes.
struct NewModel<'a> {
    name: &'a ModelName,
    method: &'a str,
    /// JSON.
    settings: &'a str,
    live: Option<i64>,
    head: Option<i64>,
    paused: bool,
    created_at: &'a str,
}

/// Lets the connection see the rows of the database it has as `origin`: `main`, or one that is attached.
async fn begin(connection: &mut SqliteConnection, origin: &'static str) -> Result<(), StoreError> {
    let definitions = include_str!("origin.sql").replace("ORIGIN", origin);
    raw_sql(AssertSqlSafe(definitions)).execute(connection).await?;
    Ok(())
}

async fn end(connection: &mut SqliteConnection) -> Result<(), StoreError> {
    raw_sql(include_str!("end.sql")).execute(connection).await?;
    Ok(())
}

/// Copies what is chosen of the model with row id `of` where this began, and gives the new model's row id. In a transaction of
/// the caller's, who knows that the name is free.
async fn copy(
    connection: &mut SqliteConnection,
    of: i64,
    chosen: Chosen,
    new: &NewModel<'_>,
) -> Result<i64, StoreError> {
    choose::choose(connection, of, chosen).await?;
    intact::look(connection, of).await?;
    let row = query(
        "insert into model (name, method, settings, live_version, head_version, paused, created_at)
         values (?, ?, ?, ?, ?, ?, ?) returning model_id",
    )
    .bind(new.name.as_str())
    .bind(new.method)
    .bind(new.settings)
    .bind(new.live)
    .bind(new.head)
    .bind(new.paused)
    .bind(new.created_at)
    .fetch_one(&mut *connection)
    .await?;
    let to: i64 = row.try_get("model_id")?;
    rows::write(connection, of, to, chosen).await?;
    end(connection).await?;
    seal::seal(connection).await?;
    Ok(to)
}

/// The rows of a statement about the model with row id `of`.
async fn rows_of(
    connection: &mut SqliteConnection,
    statement: &'static str,
    of: i64,
) -> Result<Vec<SqliteRow>, StoreError> {
    Ok(query(statement).bind(of).fetch_all(connection).await?)
}
