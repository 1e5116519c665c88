//! The real binary, killed with SIGKILL at moments drawn from a seed, and started again on the same database.
//!
//! `HEADWAY_KILL_SEED` chooses the moments and `HEADWAY_KILLS` says how many each test has:
//! `HEADWAY_KILLS=1000 HEADWAY_KILL_SEED=7 cargo test --release --test faults`.

#![allow(clippy::unwrap_used, reason = "what a test expects, said in the shortest way")]
#![allow(clippy::print_stdout, reason = "a test tells its seed and what it measured")]

#[allow(dead_code, reason = "each test binary uses a part")]
#[path = "../support/process.rs"]
mod process;

/// A clock, a disk and a file system that turn against the process.
mod adverse;
/// Bits flipped and ends cut off.
mod flips;
/// No room on the disk.
mod full;
/// Clients that go away.
mod leaving;
/// A life in which everything happens that changes a database.
mod life;
/// Readers, and how long the write-ahead log becomes.
mod log;
/// File systems of a test's own.
mod mounted;
/// Which moments.
mod plan;
/// Killed before and after every commit.
mod points;
/// Libraries under a process.
mod preloaded;
/// What a dead process left on the disk.
mod remains;
/// Events to upload.
mod traffic;
/// Requests whose every byte is ours.
mod wire;

/// Killed while live or head move.
mod moves;
/// Killed while it unlearns.
mod replaying;
/// Killed while it starts.
mod starting;
/// What is written, synced and answered, in its order.
mod traced;
/// Killed while a task learns.
mod training;
/// A disk that forgets what was not synced.
mod unsynced;
/// Killed while events come in.
mod uploads;

/// Small networks, and nothing that happens by itself.
const SETTINGS: [&str; 9] = [
    "model.hidden=6",
    "model.horizon=5",
    "model.minibatch=8",
    "model.promotion=auto",
    "model.test_reservoir=20",
    "training.training_threads=1",
    "training.max_crashes=1000000",
    "ingest.buffer_bytes=65536",
    "log.filter=warn",
];
