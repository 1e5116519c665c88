//! Whether a database is what was written: its pages, every digest, and what always holds between its rows.
//!
//! Opened to read only, and looked at as of one moment, a server may go on writing. What is checked here is what a kill, a
//! full disk or a flipped bit must never leave behind, so that a test can be the judge of a database by its path.
//! Every table is read whole: that is what it is for, and no statement here is one of the server's.

mod digests;
mod fingerprints;
mod invariants;
mod pages;

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Serialize;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions as _, Connection as _, Row, query};

use super::{StoreError, beside, frames, schema};

/// Most faults that are kept; all are counted.
const LISTED: usize = 1000;

/// Something that is not as it must be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Fault {
    /// Which check found it.
    pub check: &'static str,
    /// Where, in the words of the interface.
    pub place: String,
    /// What is wrong.
    pub detail: String,
}

/// What one check looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Checked {
    /// Its name.
    pub check: &'static str,
    /// How many things it looked at.
    pub looked_at: u64,
    /// How many of them were not as they must be.
    pub faults: u64,
}

/// What a database was found to be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Verification {
    /// The file.
    pub database: PathBuf,
    /// Its schema; 0 when that cannot be read.
    pub schema: i64,
    /// Every check, in order.
    pub checks: Vec<Checked>,
    /// What is wrong, the first thousand of them.
    pub faults: Vec<Fault>,
}

impl Verification {
    /// Whether nothing is wrong.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.checks.iter().all(|checked| checked.faults == 0)
    }

    /// How many faults there are, listed or not.
    #[must_use]
    pub fn faults_in_all(&self) -> u64 {
        self.checks.iter().map(|checked| checked.faults).sum()
    }
}

/// How far a verification is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Looking {
    /// The check under way.
    pub check: &'static str,
    /// Things it has looked at.
    pub done: u64,
    /// Things it will look at; 0 when that is not known.
    pub of: u64,
}

/// A verification under way.
struct Findings<'a> {
    progress: &'a (dyn Fn(Looking) + Sync),
    check: &'static str,
    looked_at: u64,
    of: u64,
    /// Of this check.
    found: u64,
    checks: Vec<Checked>,
    faults: Vec<Fault>,
}

impl Findings<'_> {
    /// Begins a check of so many things; 0 when that is not known.
    fn begin(&mut self, check: &'static str, of: u64) {
        (self.check, self.looked_at, self.of, self.found) = (check, 0, of, 0);
        self.tell();
    }

    /// Looked at one more thing.
    fn looked(&mut self) {
        self.looked_at += 1;
        if self.looked_at.is_multiple_of(256) {
            self.tell();
        }
    }

    fn tell(&self) {
        (self.progress)(Looking { check: self.check, done: self.looked_at, of: self.of });
    }

    fn fault(&mut self, place: impl Into<String>, detail: impl Into<String>) {
        self.found += 1;
        if self.faults.len() < LISTED {
            self.faults.push(Fault { check: self.check, place: place.into(), detail: detail.into() });
        }
    }

    /// Ends the check. What could not be read because it is damaged is one more fault, and no end of the others.
    fn end(&mut self, outcome: Result<(), StoreError>) -> Result<(), StoreError> {
        match outcome {
            Err(error @ (StoreError::Damaged(_) | StoreError::Malformed { .. } | StoreError::Corrupt { .. })) => {
                self.fault("the database file", error.to_string());
            }
            other => other?,
        }
        self.checks.push(Checked { check: self.check, looked_at: self.looked_at, faults: self.found });
        Ok(())
    }
}

/// Looks at the database at `path`; `progress` is told how far it is.
///
/// # Errors
/// When there is none, it is none of Headway's, it is newer than this release, or it cannot be read for another reason
/// than its damage.
pub async fn verify(path: &Path, progress: &(dyn Fn(Looking) + Sync)) -> Result<Verification, StoreError> {
    let mut findings =
        Findings { progress, check: "", looked_at: 0, of: 0, found: 0, checks: Vec::new(), faults: Vec::new() };
    let mut schema = 0;
    findings.begin("header", 1);
    findings.looked();
    let log = beside(path, "-wal");
    if let Ok(Some(frame)) = frames::first_damaged(&log) {
        findings.fault("the write-ahead log", StoreError::DamagedLog { path: log, frame }.to_string());
    }
    let opened = open(path).await;
    let opened = match opened {
        Ok(mut connection) => schema::read(&mut connection, path).await.map(|found| (connection, found)),
        Err(error) => Err(error),
    };
    match opened {
        Ok((mut connection, found)) => {
            schema = found;
            findings.end(Ok(()))?;
            look(&mut connection, schema, &mut findings).await?;
            connection.close().await?;
        }
        Err(error) => findings.end(Err(error))?,
    }
    Ok(Verification { database: path.to_owned(), schema, checks: findings.checks, faults: findings.faults })
}

/// A connection that only reads and whose statements nobody logs.
pub(super) async fn open(path: &Path) -> Result<SqliteConnection, StoreError> {
    const SQLITE_CANTOPEN: &str = "14";
    if !path.is_file() {
        return Err(StoreError::Absent { path: path.to_owned() });
    }
    let options = SqliteConnectOptions::new()
        .filename(path)
        .read_only(true)
        // It may be anybody's.
        .pragma("trusted_schema", "off")
        .pragma("cell_size_check", "on")
        .busy_timeout(Duration::from_secs(30))
        .disable_statement_logging();
    let mut connection = options.connect().await?;
    match query("select count(*) from sqlite_schema").fetch_one(&mut connection).await {
        // Where the folder cannot be written there is no place for the index of the write-ahead log; nor is there a log.
        Err(error) if error.as_database_error().is_some_and(|e| e.code().as_deref() == Some(SQLITE_CANTOPEN)) => {
            Ok(options.immutable(true).connect().await?)
        }
        Err(error) => Err(error.into()),
        Ok(_) => Ok(connection),
    }
}

/// What only later schemas know, as the checks see it: whether it is known, and the view if it is and if it is not.
///
/// What was erased has no arrays; of what retention did not keep there are no arrays, no weights, and no anchors that another
/// version holds on to.
const VIEWS: [(&str, &str, &str); 4] = [
    (
        "select count(*) from pragma_table_info('task') where name = 'replay_id'",
        "create temp view learning as select * from task where kind = 'learn'",
        "create temp view learning as select *, null as replay_id from task",
    ),
    (
        "select count(*) from sqlite_schema where name = 'taint'",
        "create temp view tainted as select distinct model_id, version from taint",
        "create temp view tainted as select model_id, version from version where 0",
    ),
    (
        "select count(*) from sqlite_schema where name = 'pruned'",
        "create temp view dropped as select model_id, version from pruned",
        "create temp view dropped as select model_id, version from version where 0",
    ),
    (
        "select count(*) from pragma_table_info('event') where name = 'pruned_at'",
        "create temp view kept_event as select * from event
             where pruned_at is null and not (state = 'retracted' and length(arrays) = 0)",
        "create temp view kept_event as select * from event where not (state = 'retracted' and length(arrays) = 0)",
    ),
];

/// Anchors but those whose every version retention did not keep.
const KEPT_ANCHORS: &str =
    "create temp view kept_anchor as select * from anchor a where length(importance) > 0 or exists (
    select 1 from version_regime r where r.anchor_id = a.anchor_id
        and not exists (select 1 from dropped d where d.model_id = r.model_id and d.version = r.version))";

async fn look(connection: &mut SqliteConnection, schema: i64, findings: &mut Findings<'_>) -> Result<(), StoreError> {
    // Everything is as of this moment, however much is written meanwhile.
    query("begin").execute(&mut *connection).await?;
    let outcome = pages::definitions_are(connection, schema, findings).await;
    findings.end(outcome)?;
    if findings.checks.last().is_some_and(|definitions| definitions.faults > 0) {
        // No other statement can be relied on.
        return Ok(());
    }
    for (known, view, otherwise) in VIEWS {
        let view = if count(connection, known).await? > 0 { view } else { otherwise };
        query(view).execute(&mut *connection).await?;
    }
    query(KEPT_ANCHORS).execute(&mut *connection).await?;
    let outcome = pages::pages(connection, findings).await;
    findings.end(outcome)?;
    let outcome = pages::references(connection, findings).await;
    findings.end(outcome)?;
    digests::look(connection, schema, findings).await?;
    let outcome = fingerprints::look(connection, findings).await;
    findings.end(outcome)?;
    invariants::look(connection, findings).await?;
    query("commit").execute(&mut *connection).await?;
    Ok(())
}

/// How many rows a table has.
async fn count(connection: &mut SqliteConnection, statement: &'static str) -> Result<u64, StoreError> {
    let row = query(statement).fetch_one(connection).await?;
    Ok(u64::try_from(row.try_get::<i64, _>(0)?).unwrap_or_default())
}
