use std::any::Any;
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use futures_util::FutureExt;
use tokio::sync::oneshot;

pub(crate) use shuttle::future::yield_now;
pub(crate) use shuttle::sync::{Mutex, MutexGuard};
pub(crate) use std::sync::PoisonError;
pub(crate) use std::sync::atomic::{AtomicBool, Ordering};

/// What is swapped as a whole; between any two looks at it others have their turns.
#[derive(Debug, Default)]
pub(crate) struct ArcSwap<T>(Mutex<Arc<T>>);

impl<T> ArcSwap<T> {
    pub(crate) fn load(&self) -> Arc<T> {
        Arc::clone(&self.0.lock().unwrap())
    }

    pub(crate) fn store(&self, value: Arc<T>) {
        *self.0.lock().unwrap() = value;
    }
}

/// A task; that it panics is nobody's concern, as in tokio.
pub(crate) fn spawn(work: impl Future<Output = ()> + Send + 'static) {
    drop(shuttle::future::spawn(AssertUnwindSafe(work).catch_unwind().map(drop)));
}

/// A thread, and what comes out of it.
pub(crate) async fn spawn_blocking<R: Send + 'static>(
    work: impl FnOnce() -> R + Send + 'static,
) -> Result<R, Box<dyn Any + Send>> {
    let (answer, answered) = oneshot::channel();
    // Who no longer listens has hung up.
    shuttle::thread::spawn(move || drop(answer.send(catch_unwind(AssertUnwindSafe(work)))));
    answered.await.unwrap()
}
