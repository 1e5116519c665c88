//! A write transaction, and what it changes.

use std::ops::{Deref, DerefMut};

use fail::fail_point;
use sqlx::{Sqlite, SqliteConnection, Transaction};

use super::StoreError;

/// What a transaction is made for. Said by what changes the rows, not by who asks for it, so that nothing is changed under
/// another name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// A model is created.
    ModelCreated,
    /// A model begins where another one's version is.
    ModelForked,
    /// A model is taken in from an archive.
    ModelTakenIn,
    /// A model's training is held or released.
    ModelPaused,
    /// What of a model is kept is changed.
    RetentionChanged,
    /// A batch arrived.
    BatchUploaded,
    /// A batch is retracted.
    BatchRetracted,
    /// Tasks are created.
    TaskCreated,
    /// Tasks of a process that is gone are put back in line.
    TaskTakenOver,
    /// A task starts or goes on.
    TaskStarted,
    /// A task says where it would go on.
    TaskCheckpointed,
    /// A task is held.
    TaskPutBack,
    /// Somebody wants a running task to end.
    TaskCancelRequested,
    /// A task made a version.
    TaskSucceeded,
    /// A task failed.
    TaskFailed,
    /// A task was cancelled.
    TaskCancelled,
    /// Live moves.
    Promoted,
    /// Live and head move.
    RolledBack,
    /// A version comes from elsewhere.
    VersionImported,
    /// A version's note is written.
    VersionNoted,
    /// A replay ends.
    ReplayEnded,
    /// Some of a batch's content is erased.
    ContentErased,
    /// A batch's content is gone from the files.
    ErasureNoted,
    /// Events lose their arrays.
    EventsPruned,
    /// A version loses its weights.
    VersionPruned,
    /// A source may train again.
    SourceReleased,
    /// A backup was taken.
    BackupTaken,
    /// A model was handed out as an archive.
    ArchiveTaken,
    /// A key is made.
    KeyCreated,
    /// A key is revoked.
    KeyRevoked,
}

impl Purpose {
    /// Every purpose.
    pub const ALL: [Self; 30] = [
        Self::ModelCreated,
        Self::ModelForked,
        Self::ModelTakenIn,
        Self::ModelPaused,
        Self::RetentionChanged,
        Self::BatchUploaded,
        Self::BatchRetracted,
        Self::TaskCreated,
        Self::TaskTakenOver,
        Self::TaskStarted,
        Self::TaskCheckpointed,
        Self::TaskPutBack,
        Self::TaskCancelRequested,
        Self::TaskSucceeded,
        Self::TaskFailed,
        Self::TaskCancelled,
        Self::Promoted,
        Self::RolledBack,
        Self::VersionImported,
        Self::VersionNoted,
        Self::ReplayEnded,
        Self::ContentErased,
        Self::ErasureNoted,
        Self::EventsPruned,
        Self::VersionPruned,
        Self::SourceReleased,
        Self::BackupTaken,
        Self::ArchiveTaken,
        Self::KeyCreated,
        Self::KeyRevoked,
    ];

    /// Its name.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::ModelCreated => "model_created",
            Self::ModelForked => "model_forked",
            Self::ModelTakenIn => "model_taken_in",
            Self::ModelPaused => "model_paused",
            Self::RetentionChanged => "retention_changed",
            Self::BatchUploaded => "batch_uploaded",
            Self::BatchRetracted => "batch_retracted",
            Self::TaskCreated => "task_created",
            Self::TaskTakenOver => "task_taken_over",
            Self::TaskStarted => "task_started",
            Self::TaskCheckpointed => "task_checkpointed",
            Self::TaskPutBack => "task_put_back",
            Self::TaskCancelRequested => "task_cancel_requested",
            Self::TaskSucceeded => "task_succeeded",
            Self::TaskFailed => "task_failed",
            Self::TaskCancelled => "task_cancelled",
            Self::Promoted => "promoted",
            Self::RolledBack => "rolled_back",
            Self::VersionImported => "version_imported",
            Self::VersionNoted => "version_noted",
            Self::ReplayEnded => "replay_ended",
            Self::ContentErased => "content_erased",
            Self::ErasureNoted => "erasure_noted",
            Self::EventsPruned => "events_pruned",
            Self::VersionPruned => "version_pruned",
            Self::SourceReleased => "source_released",
            Self::BackupTaken => "backup_taken",
            Self::ArchiveTaken => "archive_taken",
            Self::KeyCreated => "key_created",
            Self::KeyRevoked => "key_revoked",
        }
    }
}

/// The one transaction that writes; dropped without a commit it never happened.
///
/// Around every commit lie two fail points, `PURPOSE.before` and `PURPOSE.after`: in a build for tests the variable `FAILPOINTS`
/// makes the process die there (`return`) or lets the disk be slow (`sleep(MS)`). Other builds have none.
#[derive(Debug)]
pub struct WriteTransaction {
    inner: Transaction<'static, Sqlite>,
    purpose: Option<Purpose>,
    /// In whose name: the `name` of an `Actor`.
    actor: String,
}

impl WriteTransaction {
    pub(super) fn new(inner: Transaction<'static, Sqlite>, actor: &str) -> Self {
        Self { inner, purpose: None, actor: actor.to_owned() }
    }

    /// In whose name its changes are made.
    pub(super) fn actor(&self) -> String {
        self.actor.clone()
    }

    /// Says what this is for. What was said first stays: a rollback cancels tasks, and is a rollback.
    pub(super) fn is_for(&mut self, purpose: Purpose) {
        self.purpose.get_or_insert(purpose);
    }

    /// Makes it durable: it is on the disk when this returns.
    ///
    /// # Errors
    /// When the database cannot be written; then nothing of it happened.
    pub async fn commit(self) -> Result<(), StoreError> {
        let purpose = self.purpose.map_or("unnamed", Purpose::as_str);
        fail_point!(&format!("{purpose}.before"), |_| std::process::abort());
        self.inner.commit().await?;
        tracing::trace!(purpose, "committed");
        fail_point!(&format!("{purpose}.after"), |_| std::process::abort());
        Ok(())
    }
}

impl Deref for WriteTransaction {
    type Target = SqliteConnection;

    fn deref(&self) -> &SqliteConnection {
        &self.inner
    }
}

impl DerefMut for WriteTransaction {
    fn deref_mut(&mut self) -> &mut SqliteConnection {
        &mut self.inner
    }
}
