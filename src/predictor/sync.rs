//! What the swap and the batcher wait for each other with. `tests/schedules` compiles both once more with its own, and tries
//! out in which order threads may come by.

pub(super) use std::sync::atomic::{AtomicBool, Ordering};
pub(super) use std::sync::{Mutex, MutexGuard, PoisonError};

pub(super) use arc_swap::ArcSwap;
pub(super) use tokio::task::{spawn, spawn_blocking, yield_now};
