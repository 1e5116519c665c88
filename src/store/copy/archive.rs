//! A model in a file of its own: a database of this release's schema that holds the model, all of it, and nothing else.

use std::fs::File;
use std::io::{self, Read as _, Seek as _};
use std::path::{Path, PathBuf};

use sha2::{Digest as _, Sha256};
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteRow, SqliteSynchronous};
use sqlx::{ConnectOptions as _, Connection as _, Row, query};
use tempfile::TempDir;

use super::{Chosen, NewModel, begin, copy, examine};
use crate::lineage::{Model, ModelName};
use crate::store::backup::{draft, publish, sound};
use crate::store::verify::{Looking, Verification};
use crate::store::{Purpose, Store, StoreError, WriteTransaction, audit, model, schema};

/// Under which name a second database is attached.
const ORIGIN: &str = "origin";

/// Bytes read at once.
const PIECE_BYTES: usize = 256 << 10;

/// A file that is one, in a folder of its own that goes with this.
#[derive(Debug)]
pub struct Archive {
    folder: TempDir,
}

fn refused(path: &Path) -> impl Fn(io::Error) -> StoreError + use<'_> {
    |source| StoreError::File { path: path.to_owned(), source }
}

/// A file's name as it is attached, to read only.
fn to_read(path: &Path) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/-._~".contains(&byte);
    let bytes = path.as_os_str().as_encoded_bytes().iter();
    let escaped: String =
        bytes.map(|&byte| if plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") }).collect();
    format!("file:{escaped}?mode=ro")
}

async fn attach(connection: &mut SqliteConnection, path: &Path) -> Result<(), StoreError> {
    detach(connection).await?;
    query("attach ? as origin").bind(to_read(path)).execute(connection).await?;
    Ok(())
}

async fn detach(connection: &mut SqliteConnection) -> Result<(), StoreError> {
    let row = query("select count(*) as attached from pragma_database_list where name = 'origin'")
        .fetch_one(&mut *connection)
        .await?;
    if row.try_get::<i64, _>("attached")? > 0 {
        query("detach origin").execute(connection).await?;
    }
    Ok(())
}

fn new_model<'a>(name: &'a ModelName, row: &'a SqliteRow) -> Result<NewModel<'a>, StoreError> {
    Ok(NewModel {
        name,
        method: row.try_get("method")?,
        settings: row.try_get("settings")?,
        live: row.try_get("live_version")?,
        head: row.try_get("head_version")?,
        paused: row.try_get("paused")?,
        created_at: row.try_get("created_at")?,
    })
}

impl Archive {
    /// An empty folder within `folder`, or the system's temporary one when that is empty.
    fn empty(folder: &Path) -> Result<Self, StoreError> {
        let builder = || tempfile::Builder::new().prefix(".headway-archive-").to_owned();
        let made = if folder.as_os_str().is_empty() { builder().tempdir() } else { builder().tempdir_in(folder) };
        Ok(Self { folder: made.map_err(refused(folder))? })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        self.folder.path().join("archive.db")
    }

    /// Puts a model of the database at `database`, which a server may own and write to, into a file within `folder`, and
    /// verifies that. None when there is no such model. The same model gives the same bytes.
    ///
    /// # Errors
    /// When the database cannot be read, the file cannot be written, or what was to be copied is not what was written.
    pub async fn write(database: &Path, name: &ModelName, folder: &Path) -> Result<Option<Self>, StoreError> {
        let archive = Self::empty(folder)?;
        if fill(&archive.path(), database, name).await? {
            sound(&archive.path(), &|_| ()).await?;
            return Ok(Some(archive));
        }
        Ok(None)
    }

    /// What somebody sent, from its beginning.
    ///
    /// # Errors
    /// When it cannot be written into `folder`.
    pub fn received(file: &mut File, folder: &Path) -> Result<Self, StoreError> {
        let archive = Self::empty(folder)?;
        let path = archive.path();
        let written = file.rewind().and_then(|()| File::create_new(&path)).and_then(|mut to| io::copy(file, &mut to));
        written.map_err(refused(&path))?;
        Ok(archive)
    }

    /// Whether it is an archive whose model can be taken in; else why not. One of an earlier schema is brought to this
    /// release's.
    ///
    /// # Errors
    /// When the file cannot be read for another reason than what it holds.
    pub async fn examine(&self, progress: &(dyn Fn(Looking) + Sync)) -> Result<Result<(), String>, StoreError> {
        examine::examine(&self.path(), progress).await
    }

    /// Takes its model in under this name, none when that is taken; it must have been found good. Whatever comes of the transaction, the store is to
    /// [let go](Store::let_go) of the file once it has ended.
    ///
    /// # Errors
    /// When the database cannot be written, or the file cannot be read.
    pub async fn take_in(
        &self,
        transaction: &mut WriteTransaction,
        name: &ModelName,
    ) -> Result<Option<Model>, StoreError> {
        transaction.is_for(Purpose::ModelTakenIn);
        let taken = query("select 1 from model where name = ?").bind(name.as_str());
        if taken.fetch_optional(&mut **transaction).await?.is_some() {
            return Ok(None);
        }
        attach(transaction, &self.path()).await?;
        begin(transaction, ORIGIN).await?;
        let row = query("select * from from_model").fetch_one(&mut **transaction).await?;
        let from: String = row.try_get("name")?;
        audit::copies(transaction, "model.receive", &from).await?;
        let model_id = copy(transaction, row.try_get("model_id")?, Chosen::All, &new_model(name, &row)?).await?;
        Ok(Some(model::get(transaction, model_id).await?))
    }

    /// The file without its name, its length and its digest.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn unnamed(self) -> Result<(File, u64, [u8; 32]), StoreError> {
        let path = self.path();
        let read = || {
            let mut file = File::open(&path)?;
            let mut hasher = Sha256::new();
            let (mut bytes, mut piece) = (0, vec![0; PIECE_BYTES]);
            loop {
                let read = file.read(&mut piece)?;
                if read == 0 {
                    break;
                }
                hasher.update(&piece[..read]);
                bytes += read as u64;
            }
            file.rewind()?;
            Ok((file, bytes, hasher.finalize().into()))
        };
        read().map_err(refused(&path))
    }
}

/// Makes a database at `path` that holds this model of another one; `false` when there is none of that name.
async fn fill(path: &Path, database: &Path, name: &ModelName) -> Result<bool, StoreError> {
    if !database.is_file() {
        return Err(StoreError::Absent { path: database.to_owned() });
    }
    let options = SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(true)
        .foreign_keys(true)
        // Nobody has it before it is whole.
        .journal_mode(SqliteJournalMode::Off)
        .synchronous(SqliteSynchronous::Off);
    let mut connection = options.connect().await?;
    schema::make_newest(&mut connection).await?;
    attach(&mut connection, database).await?;
    // Everything is as of one moment, however much is written meanwhile.
    query("begin").execute(&mut connection).await?;
    begin(&mut connection, ORIGIN).await?;
    let row =
        query("select * from from_model where name = ?").bind(name.as_str()).fetch_optional(&mut connection).await?;
    if let Some(row) = &row {
        copy(&mut connection, row.try_get("model_id")?, Chosen::All, &new_model(name, row)?).await?;
    }
    query("commit").execute(&mut connection).await?;
    connection.close().await?;
    Ok(row.is_some())
}

/// Writes an archive of a model of the database at `database` to the new file `to`.
///
/// # Errors
/// As [`Archive::write`], and when `to` is there already.
pub async fn archive(
    database: &Path,
    name: &ModelName,
    to: &Path,
    force: bool,
    progress: &(dyn Fn(Looking) + Sync),
) -> Result<Option<Verification>, StoreError> {
    if !force && to.exists() {
        return Err(StoreError::Exists { path: to.to_owned() });
    }
    let draft = draft(to)?;
    // An empty file is an empty database.
    if !fill(&draft, database, name).await? {
        return Ok(None);
    }
    let verified = sound(&draft, progress).await?;
    publish(draft, to, force)?;
    Ok(Some(Verification { database: to.to_owned(), ..verified }))
}

/// Notes in the audit log that a model was handed out.
///
/// # Errors
/// When the database cannot be written.
pub async fn note(transaction: &mut WriteTransaction, model: &Model, bytes: u64) -> Result<(), StoreError> {
    transaction.is_for(Purpose::ArchiveTaken);
    query("insert into archive_taken (model_id, name, bytes) values (?, ?, ?)")
        .bind(model.model_id)
        .bind(model.name.as_str())
        .bind(i64::try_from(bytes).unwrap_or(i64::MAX))
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

impl Store {
    /// Lets go of the file that a model was taken in from, or was not.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub async fn let_go(&self) -> Result<(), StoreError> {
        detach(&mut *self.writer.acquire().await?).await
    }
}
