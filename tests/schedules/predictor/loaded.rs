use std::ops::Range;
use std::panic::resume_unwind;
use std::sync::Arc;

use super::{PredictError, Prediction, Simulated};
use crate::driver::Window;
use crate::store::{CORRUPT, Store, Work};

/// A version that answers its own number and the window's.
#[derive(Debug)]
pub(crate) struct Loaded {
    version: i64,
    work: Arc<Work>,
}

/// A window that can be told from every other.
pub(crate) fn ask(number: u16) -> Window {
    Window { follower_speed_mps: vec![0.0], leader_speed_mps: vec![0.0], spacing_m: vec![number.into()] }
}

impl Loaded {
    pub(crate) fn new(version: i64, work: &Arc<Work>) -> Self {
        Self { version, work: Arc::clone(work) }
    }

    /// Takes a while, in which others have their turns.
    pub(super) async fn load(store: &Store, _model_id: i64, version: i64) -> Result<Self, PredictError> {
        shuttle::future::yield_now().await;
        if version == CORRUPT { Err(PredictError::Unusable(version)) } else { Ok(Self::new(version, &store.work)) }
    }

    pub(crate) fn version(&self) -> i64 {
        self.version
    }

    pub(crate) fn predict(&self, windows: &[Window]) -> Result<Vec<Prediction>, PredictError> {
        self.predict_some(windows, 0..windows.len())
    }

    /// A window without a spacing cannot be read, and one that drives backwards is a bug that shows.
    pub(super) fn predict_some(&self, windows: &[Window], some: Range<usize>) -> Result<Vec<Prediction>, PredictError> {
        if let Some(window) = some.clone().find(|&at| windows[at].spacing_m.is_empty()) {
            return Err(PredictError::WindowLength { window, member: "spacing_m", found: 0, horizon: 1 });
        }
        shuttle::thread::yield_now();
        if windows[some.clone()].iter().any(|window| window.follower_speed_mps[0] < 0.0) {
            // Without a word from the panic hook.
            resume_unwind(Box::new("a bug"));
        }
        let answer = |window: &Window| {
            self.work.computed(window.spacing_m[0] as u16);
            let raw_accel_mps2 = f32::from(u16::try_from(self.version).unwrap());
            Prediction { accel_mps2: window.spacing_m[0], raw_accel_mps2, flags: Vec::new() }
        };
        Ok(windows[some].iter().map(answer).collect())
    }

    pub(crate) fn simulate(&self, _initial: &Window, _leader_speed_mps: &[f32]) -> Result<Simulated, PredictError> {
        unreachable!("nobody drives version {} on: simulations take the way of large predictions", self.version)
    }
}
