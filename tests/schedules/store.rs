use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use shuttle::future::yield_now;

/// The only model.
pub(crate) const MODEL_ID: i64 = 1;

/// A version that cannot be loaded, and the ancestor that serves in its place and was never promoted itself.
pub(crate) const CORRUPT: i64 = 5;
pub(crate) const ANCESTOR: i64 = 4;

#[derive(Debug, thiserror::Error)]
#[error("the database failed")]
pub(crate) struct StoreError;

/// What was computed, how often. Looking at it is no turn.
#[derive(Debug, Default)]
pub(crate) struct Work(Mutex<BTreeMap<u16, u32>>);

impl Work {
    pub(crate) fn computed(&self, number: u16) {
        *self.0.lock().unwrap().entry(number).or_default() += 1;
    }

    pub(crate) fn times(&self, number: u16) -> u32 {
        self.0.lock().unwrap().get(&number).copied().unwrap_or(0)
    }
}

#[derive(Debug)]
struct Moves {
    /// Every version that was live, in the order of the commits; none twice.
    live: Vec<i64>,
    /// How many of the first of them had been answered when somebody last looked.
    answered: usize,
}

/// Which versions there are, and which was live when.
#[derive(Debug)]
pub(crate) struct Store {
    pub(crate) work: Arc<Work>,
    moves: Mutex<Moves>,
}

pub(crate) struct Name(String);

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

pub(crate) struct Model {
    pub(crate) name: Name,
    pub(crate) live: Option<i64>,
}

impl Store {
    /// One in which this version is live.
    pub(crate) fn new(live: i64) -> Self {
        Self { work: Arc::default(), moves: Mutex::new(Moves { live: vec![live], answered: 1 }) }
    }

    /// Moves live, and gives the number of the move.
    pub(crate) async fn commit(&self, version: i64) -> usize {
        yield_now().await;
        let mut moves = self.moves.lock().unwrap();
        moves.live.push(version);
        moves.live.len()
    }

    /// Somebody was answered that this move is made.
    pub(crate) fn answered(&self, moved: usize) {
        let mut moves = self.moves.lock().unwrap();
        moves.answered = moves.answered.max(moved);
    }

    /// The last move that somebody was answered.
    pub(crate) fn last_answered(&self) -> usize {
        self.moves.lock().unwrap().answered
    }

    /// The move that made this version answer; none when nothing did.
    pub(crate) fn move_to(&self, serving: i64) -> Option<usize> {
        let live = if serving == ANCESTOR { CORRUPT } else { serving };
        let moves = self.moves.lock().unwrap();
        moves.live.iter().position(|&version| version == live).map(|at| at + 1)
    }

    /// What answers once everything has settled: the version that is live, and what serves for it.
    pub(crate) fn settled(&self) -> (i64, i64) {
        let live = *self.moves.lock().unwrap().live.last().unwrap();
        (live, if live == CORRUPT { ANCESTOR } else { live })
    }

    pub(crate) async fn live_versions(&self) -> Result<Vec<(i64, i64)>, StoreError> {
        yield_now().await;
        Ok(vec![(MODEL_ID, self.settled().0)])
    }

    /// Others have their turns before and after it is read.
    pub(crate) async fn model_by_id(&self, _model_id: i64) -> Result<Model, StoreError> {
        yield_now().await;
        let model = Model { name: Name("m".to_owned()), live: Some(self.settled().0) };
        yield_now().await;
        Ok(model)
    }

    pub(crate) async fn parent(&self, _model_id: i64, version: i64) -> Result<Option<i64>, StoreError> {
        yield_now().await;
        Ok(Some(version - 1))
    }
}
