//! Vehicles that are answered step by step, each by the version that it began with.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Loaded, PredictError, Prediction, PredictorSettings, Vehicle};
use crate::driver::Seen;

/// What a client calls a vehicle.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum SequenceId {
    /// By number.
    Number(u64),
    /// By name.
    Text(Box<str>),
}

/// Why a step of a vehicle is not answered.
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// None of this id is open for the model: it never began, it ended, or nothing came of it for too long.
    #[error("no such sequence is open")]
    Unknown,
    /// As many are open as may be, and none is idle.
    #[error("as many sequences as may be open are")]
    Full,
    /// The step itself cannot be answered.
    #[error(transparent)]
    Predict(#[from] PredictError),
}

/// An open one.
#[derive(Debug)]
struct Open {
    vehicle: Vehicle,
    last_step: Instant,
}

type Table = HashMap<(i64, SequenceId), Arc<Mutex<Open>>>;

/// The open sequences of a server, of all models.
///
/// Each holds its version, so that neither a promotion nor a pruning in mid-manoeuvre changes who answers it. Steps of one
/// vehicle are answered one after the other; those of different ones wait for each other no longer than a look-up takes.
#[derive(Debug)]
pub struct Sequences {
    most: usize,
    idle: Duration,
    open: Mutex<Table>,
}

impl Sequences {
    /// None so far.
    #[must_use]
    pub fn new(settings: &PredictorSettings) -> Self {
        let idle = Duration::from_secs_f64(settings.sequence_idle_s);
        Self { most: settings.sequences, idle, open: Mutex::default() }
    }

    /// Begins a sequence with a version, and answers its first step. One of the same id that is open begins anew.
    ///
    /// # Errors
    /// When too many are open, or a value is not finite; then nothing has begun.
    pub fn start(
        &self,
        model_id: i64,
        id: SequenceId,
        loaded: Arc<Loaded>,
        now: Seen,
    ) -> Result<Prediction, SequenceError> {
        let mut vehicle = Vehicle::new(loaded);
        let answer = vehicle.step(now)?;
        let key = (model_id, id);
        let mut table = self.table();
        if table.len() >= self.most && !table.contains_key(&key) {
            self.drop_idle(&mut table);
            if table.len() >= self.most {
                return Err(SequenceError::Full);
            }
        }
        table.insert(key, Arc::new(Mutex::new(Open { vehicle, last_step: Instant::now() })));
        Ok(answer)
    }

    /// Answers the next step of an open sequence, and says which version did. With `onto`, another version goes on with it:
    /// it reads the last steps anew.
    ///
    /// # Errors
    /// When it is not open, or a value is not finite; then the step was not seen.
    pub fn step(
        &self,
        model_id: i64,
        id: &SequenceId,
        now: Seen,
        onto: Option<Arc<Loaded>>,
    ) -> Result<(i64, Prediction), SequenceError> {
        let found = self.find(model_id, id)?;
        let mut open = lock(&found);
        if let Some(loaded) = onto.filter(|loaded| loaded.version() != open.vehicle.version()) {
            open.vehicle = open.vehicle.moved_to(loaded);
        }
        let answer = open.vehicle.step(now)?;
        open.last_step = Instant::now();
        Ok((open.vehicle.version(), answer))
    }

    /// The version that an open sequence stays with.
    ///
    /// # Errors
    /// When it is not open.
    pub fn version(&self, model_id: i64, id: &SequenceId) -> Result<i64, SequenceError> {
        let found = self.find(model_id, id)?;
        let version = lock(&found).vehicle.version();
        Ok(version)
    }

    /// Ends a sequence. One that is not open has ended.
    pub fn end(&self, model_id: i64, id: SequenceId) {
        self.table().remove(&(model_id, id));
    }

    /// Lets go of those of which nothing came for too long: to be called now and then. A step of one is refused even before.
    pub fn tidy(&self) {
        self.drop_idle(&mut self.table());
    }

    /// How many are open.
    #[must_use]
    pub fn count(&self) -> usize {
        self.table().len()
    }

    fn find(&self, model_id: i64, id: &SequenceId) -> Result<Arc<Mutex<Open>>, SequenceError> {
        let found = self.table().get(&(model_id, id.clone())).cloned().ok_or(SequenceError::Unknown)?;
        let expired = lock(&found).last_step.elapsed() >= self.idle;
        if expired { Err(SequenceError::Unknown) } else { Ok(found) }
    }

    /// One that is being answered is not idle.
    fn drop_idle(&self, table: &mut Table) {
        table.retain(|_, open| open.try_lock().map_or(true, |open| open.last_step.elapsed() < self.idle));
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn lock(open: &Mutex<Open>) -> MutexGuard<'_, Open> {
    // A vehicle is whole between two steps, and a step that panics has answered nobody.
    open.lock().unwrap_or_else(PoisonError::into_inner)
}
