use std::sync::Arc;

use super::driver::Window;

#[path = "../../../src/predictor/answer.rs"]
mod answer;
#[path = "../../../src/predictor/company.rs"]
mod company;
#[path = "../../../src/predictor/error.rs"]
mod error;
#[path = "../../../src/predictor/large.rs"]
mod large;
#[path = "../../../src/predictor/recent.rs"]
mod recent;
#[path = "../../../src/predictor/serving.rs"]
mod serving;
#[path = "../../../src/predictor/settings.rs"]
mod settings;

/// Versions whose answers tell whose they are.
mod loaded;
/// What the scheduler sees.
pub(crate) mod sync;

pub(crate) use answer::{Prediction, Simulated};
pub(crate) use error::PredictError;
pub(crate) use loaded::{Loaded, ask};
pub(crate) use serving::{Degraded, Predictor};
pub(crate) use settings::PredictorSettings;

/// The batcher alone.
#[derive(Clone)]
pub(crate) struct Company(Arc<company::Company>);

impl Company {
    pub(crate) fn new(most_windows: usize) -> Self {
        Self(Arc::new(company::Company::new(most_windows)))
    }

    pub(crate) async fn predict(
        &self,
        loaded: Arc<Loaded>,
        windows: Vec<Window>,
    ) -> Result<Vec<Prediction>, PredictError> {
        self.0.predict(loaded, windows).await
    }

    /// Windows that wait, and whether somebody is on the way to compute them.
    pub(crate) fn waiting(&self) -> (usize, bool) {
        let queue = self.0.queue();
        (queue.windows, queue.attended)
    }
}
