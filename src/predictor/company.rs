//! Small requests that arrive while others wait or are computed are computed together.
//!
//! A window costs less in company than alone, because each weight that is loaded serves several of them, and its answer is
//! the same bits either way. Nobody waits for company: the first request of a batch lets the threads that answer take in
//! what has already arrived, and then all that is there is computed.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

use super::{Loaded, PredictError, Prediction};
use crate::driver::Window;

/// Windows computed together: as many as are worth while, and few enough that a thread is soon back to take in requests.
const TOGETHER: usize = 32;

type Answer = Result<Vec<Prediction>, PredictError>;

/// A request that waits to be computed.
#[derive(Debug)]
struct Waiting {
    loaded: Arc<Loaded>,
    windows: Vec<Window>,
    answer: oneshot::Sender<Answer>,
}

#[derive(Debug, Default)]
struct Queue {
    requests: VecDeque<Waiting>,
    /// Of all requests.
    windows: usize,
    /// Whether a task is on its way to compute what waits.
    attended: bool,
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

    fn queue(&self) -> MutexGuard<'_, Queue> {
        // The queue is whole between any two of its changes, and none of them panics.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Computes what waits once every request that has already arrived is among it.
    fn summon(self: &Arc<Self>) {
        let company = Arc::clone(self);
        tokio::spawn(async move {
            tokio::task::yield_now().await;
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
    fn take(&mut self, most: usize) -> Vec<Waiting> {
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

#[cfg(test)]
mod tests {
    use futures_util::future::{FutureExt, join_all};

    use super::super::tests::{predictor, three_versions, window};
    use super::*;

    /// Distinct windows behind a leader.
    fn windows(count: u8) -> Vec<Window> {
        (0..count).map(|at| window(9.0 + f32::from(at) / 50.0, 20.0)).collect()
    }

    #[tokio::test]
    async fn requests_of_one_version_go_together_in_order_and_others_wait() {
        let (fixture, model_id) = three_versions().await;
        let predictor = predictor(&fixture).await;
        let (one, other) =
            (predictor.version(model_id, Some(1)).await.unwrap(), predictor.version(model_id, None).await.unwrap());
        let waiting = |loaded: &Arc<Loaded>, count| Waiting {
            loaded: Arc::clone(loaded),
            windows: windows(count),
            answer: oneshot::channel().0,
        };
        let requests = VecDeque::from([waiting(&one, 1), waiting(&other, 2), waiting(&one, 3), waiting(&one, 1)]);
        let mut queue = Queue { requests, windows: 7, attended: true };
        let counts = |batch: &[Waiting]| batch.iter().map(|request| request.windows.len()).collect::<Vec<_>>();
        assert_eq!(counts(&queue.take(4)), [1, 3], "a batch is full with the request that fills it");
        assert_eq!((queue.windows, counts(&queue.take(4))), (3, vec![2]));
        assert_eq!((queue.windows, counts(&queue.take(4))), (1, vec![1]));
        assert!(queue.take(4).is_empty());
    }

    #[tokio::test]
    async fn an_answer_has_the_same_bits_in_any_company() {
        let (fixture, model_id) = three_versions().await;
        let predictor = predictor(&fixture).await;
        let versions = [
            predictor.version(model_id, Some(1)).await.unwrap(),
            predictor.version(model_id, Some(2)).await.unwrap(),
            predictor.version(model_id, None).await.unwrap(),
        ];
        let company = Arc::new(Company::new(1000));
        let requests = windows(80).into_iter().enumerate().map(|(at, window)| {
            let loaded = &versions[at % 3];
            let asked = vec![window; 1 + at % 4];
            (loaded.predict(&asked).unwrap(), company.predict(Arc::clone(loaded), asked))
        });
        let (alone, asked): (Vec<_>, Vec<_>) = requests.unzip();
        let together: Vec<_> = join_all(asked).await.into_iter().map(Result::unwrap).collect();
        assert_eq!(together, alone);
        assert_ne!(alone[0][0], alone[1][0], "versions can be told apart");
        let queue = company.queue();
        assert_eq!((queue.windows, queue.attended), (0, false));
    }

    #[tokio::test]
    async fn what_does_not_fit_is_refused_and_what_cannot_be_read_hurts_nobody_else() {
        let (fixture, model_id) = three_versions().await;
        let live = predictor(&fixture).await.version(model_id, None).await.unwrap();
        let company = Arc::new(Company::new(5));
        let mut short = window(9.0, 20.0);
        short.spacing_m.pop();
        let asked = [windows(2), vec![window(9.0, 20.0), short], windows(2), windows(1)];
        let answers = join_all(asked.into_iter().map(|asked| company.predict(Arc::clone(&live), asked))).await;
        let [first, unreadable, full, last] = &answers[..] else { panic!("four were asked") };
        assert_eq!(first.as_ref().unwrap(), &live.predict(&windows(2)).unwrap());
        assert!(matches!(unreadable, Err(PredictError::WindowLength { window: 1, .. })), "{unreadable:?}");
        assert!(matches!(full, Err(PredictError::Busy)), "{full:?}");
        assert_eq!(last.as_ref().unwrap(), &live.predict(&windows(1)).unwrap());
        company.predict(live, windows(5)).await.unwrap();
    }

    #[tokio::test]
    async fn a_request_that_is_given_up_leaves_the_others_their_answers() {
        let (fixture, model_id) = three_versions().await;
        let live = predictor(&fixture).await.version(model_id, None).await.unwrap();
        let company = Arc::new(Company::new(100));
        assert!(company.predict(Arc::clone(&live), windows(1)).now_or_never().is_none());
        assert_eq!(company.predict(Arc::clone(&live), windows(3)).await.unwrap(), live.predict(&windows(3)).unwrap());
    }
}
