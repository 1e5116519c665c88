//! Finished and half-finished stages on disk, so that an interrupted run goes on.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::measured::Measured;
use crate::training::Learned;

/// Compression of stored stages: most of them is digits.
const ZSTD_LEVEL: i32 = 3;

/// A learned stage and how it drives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct StoredStage {
    pub(super) learned: Learned,
    pub(super) measured: Measured,
    /// What was measured on the way.
    pub(super) trace: Vec<TracePoint>,
}

/// Errors after some updates of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct TracePoint {
    pub(super) update: u64,
    /// Spacing error on some test events of each task, m².
    pub(super) spacing_mse: Vec<f64>,
}

/// A stage on its way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct HalfStage {
    pub(super) checkpoint: Vec<u8>,
    pub(super) trace: Vec<TracePoint>,
}

/// The folder of stages. One process at a time has it.
pub(super) struct State {
    folder: PathBuf,
    _lock: File,
}

impl State {
    pub(super) fn open(out: &Path) -> anyhow::Result<Self> {
        let folder = out.join("stages");
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let lock =
            File::create(folder.join("lock")).with_context(|| format!("cannot write to {}", folder.display()))?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { folder, _lock: lock }),
            Err(TryLockError::WouldBlock) => bail!("another headway reproduce works in {}", out.display()),
            Err(TryLockError::Error(error)) => Err(error).with_context(|| format!("cannot lock {}", folder.display())),
        }
    }

    fn path(&self, key: &str, kind: &str) -> PathBuf {
        self.folder.join(format!("{key}.{kind}"))
    }

    /// Whether there is something under this key, be it good or not.
    pub(super) fn has(&self, key: &str) -> bool {
        self.path(key, "stage").exists()
    }

    /// Stages here that have none of these keys.
    pub(super) fn others(&self, keys: &BTreeSet<String>) -> usize {
        let names = fs::read_dir(&self.folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
        names
            .filter_map(|name| name.to_str()?.strip_suffix(".stage").map(str::to_owned))
            .filter(|key| !keys.contains(key))
            .count()
    }

    /// The finished stage of this key; none when there is none.
    pub(super) fn stage(&self, key: &str) -> anyhow::Result<Option<StoredStage>> {
        read(&self.path(key, "stage"))
    }

    pub(super) fn keep_stage(&self, key: &str, stage: &StoredStage) -> anyhow::Result<()> {
        write(&self.path(key, "stage"), stage)?;
        // The stage is whole: what led to it may stay behind if it must.
        let _ = fs::remove_file(self.path(key, "half"));
        Ok(())
    }

    pub(super) fn half(&self, key: &str) -> anyhow::Result<Option<HalfStage>> {
        read(&self.path(key, "half"))
    }

    pub(super) fn keep_half(&self, key: &str, half: &HalfStage) -> anyhow::Result<()> {
        write(&self.path(key, "half"), half)
    }

    /// Something else that took time, of this kind; none when there is none.
    pub(super) fn other<X: DeserializeOwned>(&self, key: &str, kind: &str) -> anyhow::Result<Option<X>> {
        read(&self.path(key, kind))
    }

    pub(super) fn keep_other(&self, key: &str, kind: &str, value: &impl Serialize) -> anyhow::Result<()> {
        write(&self.path(key, kind), value)
    }
}

fn read<X: DeserializeOwned>(path: &Path) -> anyhow::Result<Option<X>> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let mut text = Vec::new();
    zstd::Decoder::new(file)?.read_to_end(&mut text)?;
    Ok(Some(serde_json::from_slice(&text)?))
}

/// Whole or not at all: written beside, then put in place.
fn write(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let written = || -> anyhow::Result<()> {
        let beside = path.with_extension("new");
        let mut encoder = zstd::Encoder::new(File::create(&beside)?, ZSTD_LEVEL)?;
        encoder.include_checksum(true)?;
        encoder.write_all(&serde_json::to_vec(value)?)?;
        encoder.finish()?.sync_data()?;
        Ok(fs::rename(&beside, path)?)
    };
    written().with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_comes_back_and_what_is_broken_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let state = State::open(folder.path()).unwrap();
        assert!(State::open(folder.path()).is_err(), "one at a time");
        assert_eq!(state.half("a").unwrap(), None);
        let trace = vec![TracePoint { update: 3, spacing_mse: vec![0.1, 0.2 + 0.1] }];
        let half = HalfStage { checkpoint: vec![1, 2, 255], trace };
        state.keep_half("a", &half).unwrap();
        assert_eq!(state.half("a").unwrap(), Some(half));
        let path = state.path("a", "half");
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, &bytes).unwrap();
        assert!(state.half("a").is_err());
        fs::write(&path, &bytes[..middle]).unwrap();
        assert!(state.half("a").is_err());
    }
}
