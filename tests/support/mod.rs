//! The real server in this process, a client that holds every answer to the contract, and made-up events.

#![allow(dead_code, reason = "each test binary uses a part")]
#![expect(clippy::unwrap_used, reason = "helpers of tests say what they expect in the shortest way, as tests do")]

pub(crate) mod binary;
pub(crate) mod command;
pub(crate) mod contract;
pub(crate) mod events;
pub(crate) mod server;
