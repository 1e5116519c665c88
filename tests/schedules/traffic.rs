use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

use futures_util::future::{Either, join, select};
use shuttle::future::{block_on, spawn, yield_now};
use shuttle::rand::{Rng, thread_rng};

use crate::driver::Window;
use crate::predictor::{Degraded, PredictError, Prediction, Predictor, PredictorSettings, ask};
use crate::store::{ANCESTOR, CORRUPT, MODEL_ID, Store};
use crate::try_orders;

/// Windows that may wait; a request of up to `INLINE` waits with others.
const WAITING: usize = 4;
const INLINE: usize = 2;
/// Enough to be split among threads.
const LARGE: usize = 130;

type Answer = Result<Vec<Prediction>, PredictError>;

/// What some of the windows of a request are.
#[derive(Clone, Copy, PartialEq)]
enum Flaw {
    None,
    /// The last one cannot be read.
    Unreadable,
    /// Computing the last one panics.
    Panics,
}

/// A server, its clients, and what the clients know of each other.
struct World {
    store: Arc<Store>,
    predictor: Predictor,
    known: Mutex<Known>,
}

#[derive(Default)]
struct Known {
    numbers: u16,
    /// Windows of small requests that wait, as far as anybody knows: those that were given up count for ever.
    waiting: usize,
    /// Versions that were asked for what panics.
    panicking: BTreeSet<i64>,
}

impl World {
    async fn begin() -> Arc<Self> {
        let store = Arc::new(Store::new(1));
        let settings = PredictorSettings {
            named_versions: 1,
            inline_windows: INLINE,
            waiting_windows: WAITING,
            threads: 2,
            sequences: 2,
            sequence_idle_s: 60.0,
        };
        let predictor = Predictor::new(Arc::clone(&store), settings);
        predictor.load_all().await.unwrap();
        Arc::new(Self { store, predictor, known: Mutex::default() })
    }

    /// A promotion, or a rollback where the version is an older one.
    async fn move_to(&self, version: i64) {
        let moved = self.store.commit(version).await;
        self.predictor.refresh(MODEL_ID).await;
        self.store.answered(moved);
    }

    /// Numbers that nobody else has.
    fn numbers(&self, count: usize) -> Vec<u16> {
        let mut known = self.known.lock().unwrap();
        let from = known.numbers;
        known.numbers += u16::try_from(count).unwrap();
        (from..known.numbers).collect()
    }

    /// Asks what is live, or `named`; gives up after some turns where it has so little patience.
    async fn request(&self, named: Option<i64>, count: usize, flaw: Flaw, patience: Option<u32>) {
        let answered = self.store.last_answered();
        let loaded = match self.predictor.version(MODEL_ID, named).await {
            Err(PredictError::Unusable(CORRUPT)) if named == Some(CORRUPT) => return,
            found => found.unwrap(),
        };
        let version = loaded.version();
        match named {
            Some(named) => assert_eq!(version, named),
            None => assert!(self.store.move_to(version).unwrap() >= answered, "{version} was live before"),
        }
        let numbers = self.numbers(count);
        let mut windows: Vec<Window> = numbers.iter().copied().map(ask).collect();
        let last = windows.last_mut().unwrap();
        match flaw {
            Flaw::None => {}
            Flaw::Unreadable => last.spacing_m.clear(),
            Flaw::Panics => {
                last.follower_speed_mps[0] = -1.0;
                self.known.lock().unwrap().panicking.insert(version);
            }
        }
        let small = count <= INLINE;
        let waiting = if small { count } else { 0 };
        self.known.lock().unwrap().waiting += waiting;
        let asked = std::pin::pin!(self.predictor.predict(loaded, windows));
        let answer = match patience {
            None => asked.await,
            Some(turns) => match select(asked, std::pin::pin!(turns_of(turns))).await {
                Either::Left((answer, _)) => answer,
                Either::Right(_) => return,
            },
        };
        self.judge(&answer, version, &numbers, flaw, small);
        self.known.lock().unwrap().waiting -= waiting;
    }

    fn judge(&self, answer: &Answer, version: i64, numbers: &[u16], flaw: Flaw, small: bool) {
        let known = self.known.lock().unwrap();
        match answer {
            Ok(answers) => {
                assert!(flaw == Flaw::None);
                let told: Vec<_> = answers.iter().map(|one| (one.accel_mps2, one.raw_accel_mps2)).collect();
                let own: Vec<_> = numbers.iter().map(|&number| (f32::from(number), version as f32)).collect();
                assert_eq!(told, own, "its own answers, in order, of the version it began with");
                assert!(numbers.iter().all(|&number| self.store.work.times(number) == 1), "computed once");
            }
            Err(PredictError::Busy) => assert!(small && known.waiting > WAITING, "there was room"),
            Err(PredictError::Panicked) => assert!(known.panicking.contains(&version), "nothing of it panics"),
            Err(PredictError::WindowLength { window, .. }) => {
                assert!(flaw == Flaw::Unreadable && *window == numbers.len() - 1, "another's flaw");
            }
            Err(error) => panic!("{error}"),
        }
    }

    /// A client with requests of every kind.
    async fn client(self: Arc<Self>) {
        for _ in 0..3 {
            let drawn = thread_rng().gen_range(0..12);
            let (named, count, flaw, patience) = match drawn {
                0 => (Some(CORRUPT), 1, Flaw::None, None),
                1 => (Some(thread_rng().gen_range(1..=6)), 2, Flaw::None, None),
                2 => (None, 2, Flaw::Unreadable, None),
                3 => (None, 1, Flaw::Panics, None),
                4 => (None, LARGE, Flaw::None, None),
                5 => (None, LARGE, Flaw::Panics, None),
                6 | 7 => (None, 1, Flaw::None, Some(thread_rng().gen_range(0..6))),
                8 => (None, LARGE, Flaw::None, Some(thread_rng().gen_range(0..6))),
                _ => (None, 1 + drawn % 2, Flaw::None, None),
            };
            self.request(named, count, flaw, patience).await;
        }
    }

    /// Somebody who looks at what serves: it never goes back, and is always a whole.
    async fn observer(self: Arc<Self>) {
        let mut seen = 0;
        for _ in 0..10 {
            assert!(self.predictor.ready());
            assert_eq!(self.predictor.serving("m"), Some(MODEL_ID));
            let degraded = self.predictor.degraded();
            let corrupt = [Degraded { model: "m".to_owned(), live: CORRUPT, serving: Some(ANCESTOR) }];
            assert!(degraded.is_empty() || degraded == corrupt, "{degraded:?}");
            let now = self.store.move_to(self.predictor.answering(MODEL_ID).unwrap()).unwrap();
            assert!(now >= seen, "an older version is back");
            seen = now;
            yield_now().await;
        }
    }

    /// Nothing is left over, and as much fits as did at the beginning.
    async fn end(&self) {
        let serving = self.predictor.answering(MODEL_ID).unwrap();
        assert_eq!(serving, self.store.settled().1);
        // Requests that were given up may still be computed.
        for _ in 0..1000 {
            let loaded = self.predictor.version(MODEL_ID, None).await.unwrap();
            let numbers = self.numbers(WAITING);
            let [one, other] = [&numbers[..INLINE], &numbers[INLINE..]]
                .map(|some| self.predictor.predict(Arc::clone(&loaded), some.iter().copied().map(ask).collect()));
            if matches!(join(one, other).await, (Ok(_), Ok(_))) {
                return;
            }
            yield_now().await;
        }
        panic!("what was given up keeps its place for ever");
    }
}

async fn turns_of(turns: u32) {
    for _ in 0..turns {
        yield_now().await;
    }
}

/// Two who move live, one of them to a corrupt version in between; clients, and somebody who looks on.
fn moves_and_requests() {
    block_on(async {
        let world = World::begin().await;
        let mover = |versions: [i64; 2]| {
            let world = Arc::clone(&world);
            spawn(async move {
                for version in versions {
                    world.move_to(version).await;
                }
            })
        };
        let mut under_way = vec![mover([3, 2]), mover([CORRUPT, 6])];
        under_way.extend((0..4).map(|_| spawn(Arc::clone(&world).client())));
        under_way.push(spawn(Arc::clone(&world).observer()));
        for one in under_way {
            one.await.unwrap();
        }
        world.end().await;
    });
}

#[test]
fn whatever_moves_meanwhile_each_request_is_answered_its_own_by_one_version_that_is_not_older() {
    try_orders(moves_and_requests);
}
