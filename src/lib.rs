//! Headway: continual learning of car-following models, as a service.
//!
//! Modules in reading order; each may use those above it and none below (`tests/shape.rs` holds them to it).
//! See `ARCHITECTURE.md` for the map and the walkthroughs.

/// The network: one flat parameter vector, forward and backward passes, kernels. Pure arithmetic.
pub mod lstm;
/// Words, signs and units: event, window, integrator, physics checks, IDM and generated traffic. Pure.
pub mod car_following;
/// Drivers out of the literature, to compare with: IDM, Gipps, constant speed; closed loop. Pure.
pub mod reference;
/// What keeps a served driver from colliding, and how close it comes: envelope, stress scenarios, surrogate measures. Pure.
pub mod safety;
/// The learned driver: scaling, LSTM and limit; window accelerations and closed-loop drives. Pure.
pub mod driver;
/// What keeps a model from forgetting: importance, anchors, the penalty and its step. Pure.
pub mod consolidation;
/// How well a driver drives: closed-loop errors on events. Pure.
pub mod evaluation;
/// Learning one stage: loss, optimiser, loop, checkpoint. Pure.
pub mod training;
/// The words of the service: model, settings, batch, task, version, promotion policy. Pure.
pub mod lineage;
/// Who may do what: keys and their scopes. No I/O but the system's randomness.
pub mod access;
/// The paper's experiment: tasks, sides, measures, intervals. Pure.
pub mod protocol;
/// JSON, NDJSON, CSV, Parquet bodies into raw events.
pub mod formats;
/// Versions as files: safetensors and ONNX. Pure.
pub mod artifact;
/// The only home of SQL: one file per resource.
pub mod store;
/// An upload's way from a body to stored events.
pub mod ingest;
/// The live version behind a swap; predictions and simulations.
pub mod predictor;
/// Which task runs when: triggers, the queue, the learn job.
pub mod scheduler;
/// What goes: erasure, retention, unused pages; in small steps.
pub mod upkeep;
/// Logs and metrics.
pub mod telemetry;
/// The REST interface: router, problems, one file per resource.
pub mod http;
/// Every setting of the server, composed of each layer's own, and where it came from.
pub mod config;
/// Wiring: `serve(listener, shutdown)`.
pub mod app;
/// One file per subcommand.
pub mod cli;
