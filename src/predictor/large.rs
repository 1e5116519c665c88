//! Where requests are computed: small ones where they arrive, large ones on threads of their own.

use std::sync::Arc;

use futures_util::future::try_join_all;
use tokio::sync::Semaphore;

use super::sync::spawn_blocking;
use super::{Loaded, PredictError, Prediction, Predictor, Simulated};
use crate::driver::Window;

/// A request is split only where every thread gets at least so many windows, about half a millisecond's.
const LEAST_WINDOWS: usize = 64;

/// Runs `work` on a blocking thread when one of `threads` is free.
async fn on_a_thread<R: Send + 'static>(
    threads: &Arc<Semaphore>,
    work: impl FnOnce() -> Result<R, PredictError> + Send + 'static,
) -> Result<R, PredictError> {
    let turn = Arc::clone(threads).acquire_owned().await.expect("nobody closes it");
    let work = move || {
        // Given back when the work is done, though nobody may be waiting for it any more.
        let _turn = turn;
        work()
    };
    spawn_blocking(work).await.map_err(|_| PredictError::Panicked)?
}

impl Predictor {
    /// [`Loaded::predict`]; a large request off the async runtime, on as many threads as the settings give.
    ///
    /// # Errors
    /// As there.
    pub async fn predict(&self, loaded: Arc<Loaded>, windows: Vec<Window>) -> Result<Vec<Prediction>, PredictError> {
        if windows.len() <= self.settings.inline_windows {
            return self.company.predict(loaded, windows).await;
        }
        let pieces = self.settings.threads().min(windows.len() / LEAST_WINDOWS).max(1);
        let (each, windows) = (windows.len().div_ceil(pieces), Arc::new(windows));
        let pieces = (0..windows.len()).step_by(each).map(|from| {
            let (loaded, windows) = (Arc::clone(&loaded), Arc::clone(&windows));
            on_a_thread(&self.threads, move || loaded.predict_some(&windows, from..windows.len().min(from + each)))
        });
        Ok(try_join_all(pieces).await?.concat())
    }

    /// [`Loaded::simulate`], off the async runtime when it is a long drive.
    ///
    /// # Errors
    /// As there.
    pub async fn simulate(
        &self,
        loaded: Arc<Loaded>,
        initial: Window,
        leader_speed_mps: Vec<f32>,
    ) -> Result<Simulated, PredictError> {
        if leader_speed_mps.len() <= self.settings.inline_windows {
            return loaded.simulate(&initial, &leader_speed_mps);
        }
        on_a_thread(&self.threads, move || loaded.simulate(&initial, &leader_speed_mps)).await
    }
}
