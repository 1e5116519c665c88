//! Loaded versions: the live one of every model behind a swap, a few named ones beside them; predict, simulate and try out.
//!
//! A request takes one loaded version and keeps it to its end, so that a swap neither drops nor mixes requests.

mod answer;
mod company;
#[cfg(test)]
mod company_tests;
mod distillation;
mod error;
mod large;
mod loaded;
mod recent;
mod sequences;
#[cfg(test)]
mod sequences_tests;
mod serving;
mod settings;
mod sync;
#[cfg(test)]
mod tests;
mod trial;
mod vehicle;

pub use answer::{Flag, Prediction, Simulated};
pub use distillation::{Distillation, Distilled};
pub use error::PredictError;
pub use loaded::Loaded;
pub use sequences::{SequenceError, SequenceId, Sequences};
pub use serving::{Degraded, Predictor};
pub use settings::{PredictorSettings, TrialSettings};
pub use trial::{Scope, Trial, TriedReference, TriedRegime, TriedVersion};
pub use vehicle::Vehicle;
