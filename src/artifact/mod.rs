//! Versions as files: safetensors, from which learning goes on elsewhere, and ONNX, which only drives; and the IDM drivers
//! that come closest to one, for SUMO. Pure.
//!
//! `docs/artifacts.md` has every name, shape and key.

mod layers;
mod onnx;
mod read;
mod record;
mod safetensors;
mod sumo;

pub use layers::{Layer, layers};
pub use onnx::{OnnxNames, onnx};
pub use read::{ArtifactError, Brought, BroughtRegime, Defect, Origin, read};
pub use record::{FORMAT, Record, RememberedRegime};
pub use safetensors::{Header, header, weights_data};
pub use sumo::{VehicleType, sumo};
