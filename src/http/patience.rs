//! How long a connection is waited for: a client that never sends the rest of a request's head, never reads its answer, or
//! asks for nothing more, is let go.
//!
//! One timer a connection looks now and then at what the connection did meanwhile. Timers of every request and every read
//! would be more exact, and cost each prediction what it takes to set and to clear them.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, sleep};

use super::ServerSettings;

/// How long each silence may last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patience {
    head: Duration,
    answer: Duration,
    idle: Duration,
}

/// What a connection has done. Only its own task writes here.
#[derive(Debug, Default)]
pub(super) struct Activity {
    read: AtomicU64,
    /// Of `read`, when the last answer was given over to be written.
    read_before: AtomicU64,
    written: AtomicU64,
    /// Whether the client takes no more of an answer.
    is_stalled: AtomicBool,
    /// Whether a request is being answered: that has limits of its own.
    is_answering: AtomicBool,
}

/// What a connection waits for. While it is the same, the client has done nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Waiting {
    /// For us.
    Answer,
    /// For the client to take what is written.
    Reader { written: u64 },
    /// For the rest of a head, however slowly it comes.
    Head { before: u64 },
    /// For another request.
    Request { written: u64 },
}

impl Patience {
    /// As the settings have it.
    #[must_use]
    pub(super) fn new(settings: &ServerSettings) -> Self {
        Self {
            head: Duration::from_secs_f64(settings.head_s),
            answer: Duration::from_secs_f64(settings.answer_idle_s),
            idle: Duration::from_secs_f64(settings.idle_s),
        }
    }

    /// Ends when the connection has been waited for long enough; at most half of the shortest patience later.
    pub(super) async fn ends(self, activity: &Activity) {
        let look = self.head.min(self.answer).min(self.idle) / 4;
        let (mut waiting, mut since) = (activity.waiting(), Instant::now());
        loop {
            sleep(look).await;
            let now = activity.waiting();
            if now != waiting {
                (waiting, since) = (now, Instant::now());
            }
            let limit = match waiting {
                Waiting::Answer => continue,
                Waiting::Reader { .. } => self.answer,
                Waiting::Head { .. } => self.head,
                Waiting::Request { .. } => self.idle,
            };
            if since.elapsed() >= limit {
                tracing::debug!(?waiting, "a connection is let go");
                return;
            }
        }
    }
}

impl Activity {
    /// A request's head is complete.
    pub(super) fn asked(&self) {
        self.is_answering.store(true, Ordering::Relaxed);
    }

    /// Its answer is there to be written.
    pub(super) fn answered(&self) {
        self.read_before.store(self.read.load(Ordering::Relaxed), Ordering::Relaxed);
        self.is_answering.store(false, Ordering::Relaxed);
    }

    fn waiting(&self) -> Waiting {
        let [read, before, written] =
            [&self.read, &self.read_before, &self.written].map(|count| count.load(Ordering::Relaxed));
        if self.is_answering.load(Ordering::Relaxed) {
            Waiting::Answer
        } else if self.is_stalled.load(Ordering::Relaxed) {
            Waiting::Reader { written }
        } else if read > before {
            Waiting::Head { before }
        } else {
            Waiting::Request { written }
        }
    }
}

/// A stream that says what it does.
#[derive(Debug)]
pub(super) struct Watched<S> {
    stream: S,
    activity: Arc<Activity>,
}

impl<S> Watched<S> {
    /// `stream`, telling `activity`.
    #[must_use]
    pub(super) fn new(stream: S, activity: Arc<Activity>) -> Self {
        Self { stream, activity }
    }

    fn wrote(&self, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        self.activity.is_stalled.store(written.is_pending(), Ordering::Relaxed);
        let bytes = ready!(written)?;
        self.activity.written.fetch_add(bytes as u64, Ordering::Relaxed);
        Poll::Ready(Ok(bytes))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Watched<S> {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.stream).poll_read(cx, buffer))?;
        self.activity.read.fetch_add((buffer.filled().len() - before) as u64, Ordering::Relaxed);
        Poll::Ready(Ok(()))
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Watched<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.wrote(written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(cx, slices);
        self.wrote(written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
