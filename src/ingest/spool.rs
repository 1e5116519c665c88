//! A body on its way to an anonymous temporary file.

use std::fs::File;
use std::io::{self, Write};

use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use sha2::{Digest, Sha256};

use super::IngestSettings;

/// Bytes that are gathered before they are written on a blocking thread.
const WRITE_BYTES: usize = 512 << 10;

/// Why a body could not be spooled.
#[derive(Debug, thiserror::Error)]
pub enum SpoolError {
    /// It is longer than the limit.
    #[error("the body is longer than {max_bytes} bytes")]
    TooLarge {
        /// The limit.
        max_bytes: u64,
    },
    /// The file cannot be written.
    #[error("cannot spool the body: {0}")]
    Io(#[from] io::Error),
}

/// What ended a body's stream before its end.
#[derive(Debug)]
pub enum Interrupted<E> {
    /// The stream itself.
    Body(E),
    /// The spool.
    Spool(SpoolError),
}

/// A body while it comes in. Dropped, it leaves nothing.
#[derive(Debug)]
pub struct Spool {
    file: File,
    hasher: Sha256,
    bytes: u64,
    max_bytes: u64,
}

/// A body that came in.
#[derive(Debug)]
pub struct Spooled {
    /// Its bytes; nobody else can open this file, and it is gone when it is closed.
    pub file: File,
    /// Digest of its bytes.
    pub sha256: [u8; 32],
    /// How many.
    pub bytes: u64,
}

impl Spool {
    /// An empty body of at most `max_bytes`.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn create(settings: &IngestSettings, max_bytes: u64) -> Result<Self, SpoolError> {
        let file = if settings.spool_folder.as_os_str().is_empty() {
            tempfile::tempfile()?
        } else {
            tempfile::tempfile_in(&settings.spool_folder)?
        };
        Ok(Self { file, hasher: Sha256::new(), bytes: 0, max_bytes })
    }

    /// Takes what came next. Blocks while it is written.
    ///
    /// # Errors
    /// When the body is too large or the file cannot be written.
    pub fn write(&mut self, chunk: &[u8]) -> Result<(), SpoolError> {
        let bytes = self.bytes.saturating_add(chunk.len() as u64);
        if bytes > self.max_bytes {
            return Err(SpoolError::TooLarge { max_bytes: self.max_bytes });
        }
        self.file.write_all(chunk)?;
        self.hasher.update(chunk);
        self.bytes = bytes;
        Ok(())
    }

    /// The whole body.
    #[must_use]
    pub fn finish(self) -> Spooled {
        Spooled { file: self.file, sha256: self.hasher.finalize().into(), bytes: self.bytes }
    }
}

/// Spools a stream of at most `max_bytes`. Nothing blocks the runtime, and a stream that stalls occupies no thread.
///
/// # Errors
/// When the stream fails, the body is too large or the file cannot be written.
pub async fn spool<S, E>(chunks: S, settings: &IngestSettings, max_bytes: u64) -> Result<Spooled, Interrupted<E>>
where
    S: Stream<Item = Result<Bytes, E>>,
{
    let mut chunks = std::pin::pin!(chunks);
    let mut spool = Spool::create(settings, max_bytes).map_err(Interrupted::Spool)?;
    let mut gathered = Vec::new();
    while let Some(chunk) = chunks.next().await {
        gathered.extend_from_slice(&chunk.map_err(Interrupted::Body)?);
        if gathered.len() >= WRITE_BYTES {
            spool = write(spool, std::mem::take(&mut gathered)).await.map_err(Interrupted::Spool)?;
        }
    }
    Ok(write(spool, gathered).await.map_err(Interrupted::Spool)?.finish())
}

async fn write(mut spool: Spool, chunk: Vec<u8>) -> Result<Spool, SpoolError> {
    let written = tokio::task::spawn_blocking(move || spool.write(&chunk).map(|()| spool)).await;
    written.map_err(|e| SpoolError::Io(io::Error::other(e)))?
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Seek};

    use futures_util::stream;

    use super::*;

    #[tokio::test]
    async fn a_stream_is_spooled_and_hashed() {
        let chunks = vec![Bytes::from_static(b"ab"), Bytes::from(vec![7; WRITE_BYTES]), Bytes::from_static(b"c")];
        let whole: Vec<u8> = chunks.iter().flatten().copied().collect();
        let stream = stream::iter(chunks.into_iter().map(Ok::<_, ()>));
        let mut spooled = spool(stream, &IngestSettings::default(), u64::MAX).await.unwrap();
        let mut back = Vec::new();
        spooled.file.rewind().unwrap();
        spooled.file.read_to_end(&mut back).unwrap();
        assert_eq!((spooled.bytes, back.len()), (whole.len() as u64, whole.len()));
        assert_eq!(spooled.sha256, <[u8; 32]>::from(Sha256::digest(&whole)));
    }

    #[tokio::test]
    async fn a_broken_or_oversized_stream_is_refused() {
        let settings = IngestSettings::default();
        let long = stream::iter([Ok::<_, ()>(Bytes::from_static(b"abcd"))]);
        let interrupted = spool(long, &settings, 3).await.unwrap_err();
        assert!(matches!(interrupted, Interrupted::Spool(SpoolError::TooLarge { max_bytes: 3 })));
        let broken = stream::iter([Ok(Bytes::from_static(b"ab")), Err("gone")]);
        assert!(matches!(spool(broken, &settings, 3).await, Err(Interrupted::Body("gone"))));
    }
}
