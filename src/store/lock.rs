//! The lock beside a database: one process owns it. The file of the lock also says, by not being empty, that the database was
//! made.

use std::fs::{self, File, TryLockError};
use std::io::Write;
use std::path::Path;

use super::{StoreError, beside};

/// Held as long as a store lives.
#[derive(Debug)]
pub(super) struct Lock(File);

impl Lock {
    /// Takes the lock of the database at `path`.
    ///
    /// # Errors
    /// When another process has it, or it cannot be made.
    pub(super) fn take(path: &Path) -> Result<Self, StoreError> {
        let unlockable = |source| StoreError::Lock { path: path.to_owned(), source };
        let lock = File::options().create(true).truncate(false).write(true).open(beside(path, ".lock"));
        let lock = Self(lock.map_err(unlockable)?);
        match lock.0.try_lock() {
            Ok(()) => Ok(lock),
            Err(TryLockError::WouldBlock) => Err(StoreError::Owned { path: path.to_owned() }),
            Err(TryLockError::Error(source)) => Err(unlockable(source)),
        }
    }

    /// Looks that the database at `path` was not emptied, which `SQLite` would take for a new one.
    ///
    /// # Errors
    /// When it was made before and is empty now.
    pub(super) fn refuse_emptied(&self, path: &Path) -> Result<(), StoreError> {
        let is_emptied = self.was_made() && fs::metadata(path).is_ok_and(|database| database.len() == 0);
        if is_emptied { Err(StoreError::Emptied(path.to_owned())) } else { Ok(()) }
    }

    /// Notes that the database is there, once.
    pub(super) fn note_made(&self) {
        if !self.was_made()
            && let Err(error) = (&self.0).write_all(b"made\n")
        {
            tracing::warn!(%error, "were the database emptied, the next start would not know");
        }
    }

    fn was_made(&self) -> bool {
        self.0.metadata().is_ok_and(|lock| lock.len() > 0)
    }

    /// Lets another process own the database.
    pub(super) fn release(&self) {
        if let Err(error) = self.0.unlock() {
            tracing::warn!(%error, "the lock of the database goes with the process");
        }
    }
}
