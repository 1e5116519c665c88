//! The real server, over HTTP.

#![expect(clippy::unwrap_used, reason = "helpers of tests say what they expect in the shortest way, as tests do")]

#[path = "../support/mod.rs"]
mod support;

/// What fits the contract is taken.
mod accepted;
/// What is asked with which key.
mod access;
/// Versions as files.
mod artifact;
/// Who changed what.
mod audit;
/// Copies of the database.
mod backup;
/// Listing and reading batches; retracting what was never learned.
mod batches;
/// What browsers are told.
mod browsers;
/// The command line, in a database and at a server.
mod commands;
/// The router and `api/openapi.yaml` say the same.
mod contract;
mod copies;
/// Damaged databases.
mod corruption;
/// Versions as vehicle types of SUMO.
mod distilled;
/// What the server says of itself.
mod documented;
/// Content that goes for good.
mod erase;
/// Versions and reference drivers on events that are not kept.
mod evaluate;
mod export;
/// Bodies that mean harm.
mod hostile;
/// Bytes that are mistaken, at random.
mod hostile_bytes;
/// Requests that are none.
mod hostile_wire;
/// Versions out of files.
mod brought;
/// The Open Inference Protocol.
mod inference;
/// Vehicles that send step by step.
mod sequences;
/// Keys that are sent again.
mod idempotency;
/// Files, from the command line.
mod import;
/// Keys: making, listing, revoking.
mod keys;
/// Databases of servers that have done everything once.
mod lived;
/// Many requests at once.
mod load;
/// Databases of earlier releases.
mod migrations;
/// What is in the log, and what is not.
mod logged;
/// Models: create, read, pause.
mod models;
/// What dashboards and alerts ask.
mod monitoring;
mod moves;
/// Lists.
mod paging;
/// Predictions and simulations.
mod predict;
/// Requests that are wrong.
mod problems;
/// What is not kept.
mod retention;
/// Retracting what was learned.
mod retract;
/// Promote, rollback, history.
mod serving;
/// Predictions, which are recognised before the router.
mod short_way;
/// Clients that take their time.
mod slow;
/// Sources that are held.
mod sources;
/// Stopping and starting again.
mod stopping;
/// Strengths that are searched.
mod strength;
/// Learning on request.
mod tasks;
/// Encrypted connections.
mod tls;
/// Each format, good and bad.
mod uploads;
/// Whether a database is what was written.
mod verify;
/// What tasks made.
mod versions;
