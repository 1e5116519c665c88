//! Copies of a database, taken while a server writes to it, and put back in its place.

use std::fs::{self, File};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;
use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _, query};
use tempfile::TempPath;

use super::lock::Lock;
use super::verify::{self, Looking, Verification};
use super::{Purpose, Store, StoreError, WriteTransaction, beside};

/// A moment in the name of a file.
pub(super) const NAMED: &str = "%Y%m%dT%H%M%S%.6fZ";

/// A step of a copy that a file system refused.
fn refused(path: &Path) -> impl Fn(std::io::Error) -> StoreError + use<'_> {
    |source| StoreError::File { path: path.to_owned(), source }
}

/// The folder of a path.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new empty file beside `path`, that goes unless it is kept.
pub(crate) fn draft(path: &Path) -> Result<TempPath, StoreError> {
    let draft = tempfile::Builder::new().prefix(".headway-").suffix(".partial").tempfile_in(folder(path));
    Ok(draft.map_err(refused(path))?.into_temp_path())
}

/// Makes sure that a file and its name outlive a power cut.
fn settle(path: &Path) -> std::io::Result<()> {
    File::open(path)?.sync_all()?;
    File::open(folder(path))?.sync_all()
}

/// Gives a finished draft its name.
pub(crate) fn publish(draft: TempPath, to: &Path, force: bool) -> Result<(), StoreError> {
    File::open(&draft).and_then(|file| file.sync_all()).map_err(refused(to))?;
    let named = if force { draft.persist(to) } else { draft.persist_noclobber(to) };
    named.map_err(|error| error.error).and_then(|()| settle(to)).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => StoreError::Exists { path: to.to_owned() },
        _ => refused(to)(error),
    })
}

/// A copy of the database as of one moment, in one file without a write-ahead log, under a name that goes.
async fn copy(database: &Path, to: &Path) -> Result<TempPath, StoreError> {
    let draft = draft(to)?;
    let name = draft.to_str().ok_or_else(|| refused(to)(std::io::Error::other("the path is not UTF-8")))?.to_owned();
    let mut connection = verify::open(database).await?;
    // Reads in one transaction, so the log of a server that writes grows meanwhile; it takes no lock that a writer needs.
    query("vacuum into ?").bind(name).execute(&mut connection).await?;
    connection.close().await?;
    Ok(draft)
}

/// Writes a backup without looking at what it holds.
///
/// # Errors
/// When the database cannot be read, the backup cannot be written, or there is something of its name and no `force`.
pub(super) async fn write(database: &Path, to: &Path, force: bool) -> Result<(), StoreError> {
    publish(copy(database, to).await?, to, force)
}

/// Writes a backup of the database at `database`, which a server may own and write to, to the new file `to`, and verifies
/// it before it gets its name. `progress` is told how far the verification is.
///
/// # Errors
/// When the database cannot be read, what was written is not sound, it cannot be written, or there is something of its name
/// and no `force`.
pub async fn backup(
    database: &Path,
    to: &Path,
    force: bool,
    progress: &(dyn Fn(Looking) + Sync),
) -> Result<Verification, StoreError> {
    if !force && to.exists() {
        return Err(StoreError::Exists { path: to.to_owned() });
    }
    let draft = copy(database, to).await?;
    let verified = sound(&draft, progress).await?;
    publish(draft, to, force)?;
    Ok(Verification { database: to.to_owned(), ..verified })
}

/// What was found, when it is sound.
pub(super) async fn sound(path: &Path, progress: &(dyn Fn(Looking) + Sync)) -> Result<Verification, StoreError> {
    let verified = verify::verify(path, progress).await?;
    if verified.is_sound() { Ok(verified) } else { Err(StoreError::Unsound(Box::new(verified))) }
}

/// Puts a backup in the place of the database at `database`, once it is verified. What was there stays beside it, under the
/// name this gives, unless `keep` is false.
///
/// # Errors
/// When a server owns the database, the backup is not sound, or a file cannot be written: then the database is as it was.
pub async fn restore(
    from: &Path,
    database: &Path,
    keep: bool,
    progress: &(dyn Fn(Looking) + Sync),
) -> Result<(Verification, Option<PathBuf>), StoreError> {
    if !from.is_file() {
        return Err(StoreError::Absent { path: from.to_owned() });
    }
    let _lock = Lock::take(database)?;
    let draft = copy(from, database).await?;
    let verified = sound(&draft, progress).await?;
    let kept = if database.exists() {
        let rights = fs::metadata(database).and_then(|old| fs::set_permissions(&draft, old.permissions()));
        rights.map_err(refused(database))?;
        put_aside(database, keep).await?
    } else {
        None
    };
    publish(draft, database, true)?;
    Ok((Verification { database: database.to_owned(), ..verified }, kept))
}

/// Gives the database another name as well, so that its own can be taken; its write-ahead log goes into it first, or, when it
/// is too damaged for that, along with it.
async fn put_aside(database: &Path, keep: bool) -> Result<Option<PathBuf>, StoreError> {
    if let Err(error) = fold(database).await {
        tracing::warn!(%error, "the write-ahead log of the database could not be folded into it");
    }
    let aside = beside(database, &format!(".before-restore-{}", Timestamp::now().strftime(NAMED)));
    if keep {
        fs::hard_link(database, &aside).or_else(|_| fs::copy(database, &aside).map(drop)).map_err(refused(&aside))?;
    }
    for suffix in ["-wal", "-shm"] {
        let left = beside(database, suffix);
        match (left.exists(), keep && suffix == "-wal") {
            (false, _) => {}
            (true, true) => fs::rename(&left, beside(&aside, suffix)).map_err(refused(&left))?,
            (true, false) => fs::remove_file(&left).map_err(refused(&left))?,
        }
    }
    Ok(keep.then_some(aside))
}

/// Moves the write-ahead log into the database and takes it away.
async fn fold(database: &Path) -> Result<(), StoreError> {
    let options = SqliteConnectOptions::new().filename(database).disable_statement_logging();
    let mut connection = options.connect().await?;
    query("pragma wal_checkpoint(truncate)").execute(&mut connection).await?;
    connection.close().await?;
    Ok(())
}

/// Where a server keeps its backups.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BackupSettings {
    /// The folder; none are taken when empty.
    pub folder: PathBuf,
    /// How many are kept; the oldest goes when there would be more.
    pub keep: u32,
}

/// A backup of a server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Backup {
    /// Its file in the folder.
    pub name: String,
    /// Its size.
    pub bytes: u64,
    /// When it was written.
    pub created_at: Timestamp,
}

const PREFIX: &str = "headway-";
const SUFFIX: &str = ".db";

impl BackupSettings {
    /// Every number, and the range it must lie in.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64, RangeInclusive<f64>); 1] {
        [("keep", self.keep.into(), 1.0..=1000.0)]
    }

    /// Whether there is a folder.
    #[must_use]
    pub fn is_on(&self) -> bool {
        !self.folder.as_os_str().is_empty()
    }

    /// The backups in the folder, newest first.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn list(&self) -> Result<Vec<Backup>, StoreError> {
        if !self.is_on() || !self.folder.exists() {
            return Ok(Vec::new());
        }
        let read = || -> std::io::Result<Vec<Backup>> {
            let mut found = Vec::new();
            for entry in fs::read_dir(&self.folder)? {
                let entry = entry?;
                let name = entry.file_name().to_string_lossy().into_owned();
                let time = name.strip_prefix(PREFIX).and_then(|rest| rest.strip_suffix(SUFFIX));
                let time = time.and_then(|time| DateTime::strptime(NAMED, time).ok()?.to_zoned(TimeZone::UTC).ok());
                // Whatever else lies there is none of ours.
                let Some(created_at) = time.map(|time| time.timestamp()) else { continue };
                found.push(Backup { name, bytes: entry.metadata()?.len(), created_at });
            }
            found.sort_by_key(|backup| std::cmp::Reverse(backup.created_at));
            Ok(found)
        };
        read().map_err(refused(&self.folder))
    }

    /// Takes and verifies a backup of the store's database.
    ///
    /// # Errors
    /// When it cannot be taken, or is not sound.
    pub async fn take(&self, store: &Store) -> Result<Backup, StoreError> {
        fs::create_dir_all(&self.folder).map_err(refused(&self.folder))?;
        let name = format!("{PREFIX}{}{SUFFIX}", Timestamp::now().strftime(NAMED));
        let to = self.folder.join(&name);
        backup(store.path(), &to, false, &|_| ()).await?;
        let gone = || StoreError::Absent { path: to.clone() };
        self.list()?.into_iter().find(|backup| backup.name == name).ok_or_else(gone)
    }

    /// Takes the oldest away, beyond `keep`.
    ///
    /// # Errors
    /// When a file cannot be deleted.
    pub fn trim(&self) -> Result<(), StoreError> {
        self.list()?.iter().skip(self.keep as usize).try_for_each(|old| self.discard(old))
    }

    /// Takes one away.
    ///
    /// # Errors
    /// When the file cannot be deleted.
    pub fn discard(&self, backup: &Backup) -> Result<(), StoreError> {
        fs::remove_file(self.folder.join(&backup.name)).map_err(refused(&self.folder))
    }
}

/// Notes in the audit log that a backup was taken.
///
/// # Errors
/// When the database cannot be written.
pub async fn note(transaction: &mut WriteTransaction, backup: &Backup) -> Result<(), StoreError> {
    transaction.is_for(Purpose::BackupTaken);
    query("insert into backup_taken (name, bytes) values (?, ?)")
        .bind(&backup.name)
        .bind(i64::try_from(backup.bytes).unwrap_or(i64::MAX))
        .execute(&mut **transaction)
        .await?;
    Ok(())
}
