//! The real server in this process, a client that holds every answer to the contract, and made-up events.

#![allow(dead_code, reason = "each test binary uses a part")]

pub mod contract;
pub mod events;
pub mod server;

pub use server::Server;
