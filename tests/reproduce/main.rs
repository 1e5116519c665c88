//! `headway reproduce`, the real binary: from event files to its report, interrupted and not, and what it refuses.

#![allow(clippy::unwrap_used, reason = "what a test expects, said in the shortest way")]

mod recorded;
mod refusals;
mod report;
mod resuming;
mod runs;
