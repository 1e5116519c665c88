//! Calls the interface names and this release does not answer yet: 501, once the path is right.

use super::path::{ModelAt, VersionAt};
use super::problem::{Code, Problem};

/// `GET /v1/models/{model}/versions/{version}/artifact`
pub(super) async fn artifact(_: ModelAt, _: VersionAt) -> Problem {
    Code::NotAvailable.because("downloading a version as safetensors or ONNX comes with a later release")
}

/// `POST /v1/models/{model}/versions`
pub(super) async fn import(_: ModelAt) -> Problem {
    Code::NotAvailable.because("importing weights as a version comes with a later release")
}
