//! Learning, from outside: against `PyTorch`, against itself, and against forgetting.

#![expect(clippy::unwrap_used, reason = "helpers of tests say what they expect in the shortest way, as tests do")]

mod forgetting;
mod golden;
mod importance;
mod line;
mod sampled;
mod stages;
