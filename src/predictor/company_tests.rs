//! The batcher against loaded versions.

use std::collections::VecDeque;
use std::sync::Arc;

use futures_util::future::{FutureExt, join_all};

use tokio::sync::oneshot;

use super::company::{Company, Queue, Waiting};
use super::tests::{predictor, three_versions, window};
use super::{Loaded, PredictError};
use crate::driver::Window;

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
