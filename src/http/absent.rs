//! Calls the interface names and this release does not answer yet: 501, once the path is right.

use super::path::ModelAt;
use super::problem::{Code, Problem};

/// `POST /v1/models/{model}/versions`
pub(super) async fn import(_: ModelAt) -> Problem {
    Code::NotAvailable.because("importing weights as a version comes with a later release")
}
