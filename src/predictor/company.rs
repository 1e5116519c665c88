//! Small requests that arrive while others wait or are computed are computed together.
//!
//! A window costs less in company than alone, because each weight that is loaded serves several of them, and its answer is
//! the same bits either way. Nobody waits for company: the first request of a batch lets the threads that answer take in
//! what has already arrived, and then all that is there is computed.

use std::collections::VecDeque;
use std::sync::Arc;

use tokio::sync::oneshot;

use super::sync::{Mutex, MutexGuard, PoisonError, spawn, yield_now};
use super::{Loaded, PredictError, Prediction};
use crate::driver::Window;

/// Windows computed together: as many as are worth while, and few enough that a thread is soon back to take in requests.
const TOGETHER: usize = 32;

type Answer = Result<Vec<Prediction>, PredictError>;

/// A request that waits to be computed.
#[derive(Debug)]
pub(super) struct Waiting {
    pub(super) loaded: Arc<Loaded>,
    pub(super) windows: Vec<Window>,
    pub(super) answer: oneshot::Sender<Answer>,
}

#[derive(Debug, Default)]
pub(super) struct Queue {
    pub(super) requests: VecDeque<Waiting>,
    /// Of all requests.
    pub(super) windows: usize,
    /// Whether a task is on its way to compute what waits.
    pub(super) attended: bool,
}

/// Requests of any version that wait to be computed.
#[derive(Debug)]
pub(super) struct Company {
    most_windows: usize,
    queue: Mutex<Queue>,
}

impl Company {
    /// Lets up to `most_windows` windows wait.
    pub(super) fn new(most_windows: usize) -> Self {
        Self { most_windows, queue: Mutex::default() }
    }

    /// [`Loaded::predict`], together with what else there is.
    pub(super) async fn predict(self: &Arc<Self>, loaded: Arc<Loaded>, windows: Vec<Window>) -> Answer {
        let (answer, answered) = oneshot::channel();
        {
            let mut queue = self.queue();
            if queue.windows + windows.len() > self.most_windows {
                return Err(PredictError::Busy);
            }
            queue.windows += windows.len();
            queue.requests.push_back(Waiting { loaded, windows, answer });
            if !std::mem::replace(&mut queue.attended, true) {
                self.summon();
            }
        }
        answered.await.unwrap_or(Err(PredictError::Panicked))
    }

    pub(super) fn queue(&self) -> MutexGuard<'_, Queue> {
        // The queue is whole between any two of its changes, and none of them panics.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Computes what waits once every request that has already arrived is among it.
    fn summon(self: &Arc<Self>) {
        let company = Arc::clone(self);
        spawn(async move {
            yield_now().await;
            company.attend();
        });
    }

    fn attend(self: &Arc<Self>) {
        let batch = {
            let mut queue = self.queue();
            let batch = queue.take(TOGETHER);
            queue.attended = !queue.requests.is_empty();
            if queue.attended {
                // Another thread may compute the rest meanwhile, and a panic here is no concern of theirs.
                self.summon();
            }
            batch
        };
        answer(batch);
    }
}

impl Queue {
    /// The oldest requests of the oldest's version, of about `most` windows.
    pub(super) fn take(&mut self, most: usize) -> Vec<Waiting> {
        let mut batch: Vec<Waiting> = Vec::new();
        let mut windows = 0;
        let mut at = 0;
        while windows < most && at < self.requests.len() {
            let same = batch.first().is_none_or(|first| Arc::ptr_eq(&first.loaded, &self.requests[at].loaded));
            if same {
                let request = self.requests.remove(at).expect("within the queue");
                windows += request.windows.len();
                batch.push(request);
            } else {
                at += 1;
            }
        }
        self.windows -= windows;
        batch
    }
}

/// Computes requests of one version together, and answers each.
fn answer(batch: Vec<Waiting>) {
    let Some(first) = batch.first() else { return };
    let loaded = Arc::clone(&first.loaded);
    let mut all = Vec::with_capacity(batch.iter().map(|request| request.windows.len()).sum());
    let asked: Vec<_> = batch
        .into_iter()
        .map(|Waiting { windows, answer, .. }| {
            let count = windows.len();
            all.extend(windows);
            (count, answer)
        })
        .collect();
    if let Ok(predictions) = loaded.predict(&all) {
        let mut predictions = predictions.into_iter();
        for (count, answer) in asked {
            // Who no longer listens has hung up.
            let _ = answer.send(Ok(predictions.by_ref().take(count).collect()));
        }
        return;
    }
    // One of them cannot be read: each finds out by itself whether it is the one.
    let mut rest = &all[..];
    for (count, answer) in asked {
        let (own, others) = rest.split_at(count);
        let _ = answer.send(loaded.predict(own));
        rest = others;
    }
}
