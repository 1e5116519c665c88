use std::time::{Duration, Instant, SystemTime};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::process::Process;
use crate::wire::{Answer, Wire};

const DEFAULT_SEED: u64 = 42;
const DEFAULT_KILLS: u32 = 24;

/// The draws of one test.
pub(crate) struct Plan {
    random: ChaCha8Rng,
    pub(crate) kills: u32,
}

impl Plan {
    /// The draws of the test of this number, told on stdout.
    pub(crate) fn new(test: u64) -> Self {
        let seed = variable("HEADWAY_KILL_SEED").unwrap_or(DEFAULT_SEED);
        let kills = variable("HEADWAY_KILLS").map_or(DEFAULT_KILLS, |kills| u32::try_from(kills).unwrap());
        println!("HEADWAY_KILL_SEED={seed} HEADWAY_KILLS={kills}");
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(test);
        Self { random, kills }
    }

    /// Of 0 up to `end`, which is not among them.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        self.random.random_range(0..end)
    }

    /// From 0 to 1.
    pub(crate) fn share(&mut self) -> f64 {
        self.random.random()
    }

    /// A moment in the life of a request that was sent.
    pub(crate) fn moment(&mut self, usual: Duration) -> Moment {
        match self.below(4) {
            0 => Moment::Writing,
            1 => Moment::Answered,
            _ => Moment::After(usual.mul_f64(1.2 * self.share())),
        }
    }
}

pub(crate) fn variable(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().unwrap_or_else(|_| panic!("{name}={text} is no number")))
}

/// When a request that was sent is cut off.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Moment {
    /// As soon as something is written to the database.
    Writing,
    /// So long after its last byte was sent. This chooses the moment; nothing relies on what has happened by then.
    After(Duration),
    /// When it is answered.
    Answered,
}

/// Kills the process at `moment` of a request whose last byte was sent. Gives what was answered before that.
pub(crate) fn kill_at(moment: Moment, process: &mut Process, wire: Wire, unwritten: &Written) -> Option<Answer> {
    let sent = Instant::now();
    match moment {
        Moment::Answered => {
            let answer = wire.answer();
            process.kill();
            return answer;
        }
        Moment::Writing => {
            while Written::now(&unwritten.path) == *unwritten {
                std::hint::spin_loop();
            }
        }
        Moment::After(time) => {
            while sent.elapsed() < time {
                std::hint::spin_loop();
            }
        }
    }
    process.kill();
    wire.answer()
}

/// What the write-ahead log of a database looks like from outside.
#[derive(Debug, PartialEq)]
pub(crate) struct Written {
    path: std::path::PathBuf,
    state: Option<(u64, SystemTime)>,
}

impl Written {
    pub(crate) fn now(database: &std::path::Path) -> Self {
        let metadata = std::fs::metadata(database.with_extension("db-wal")).ok();
        let state = metadata.map(|metadata| (metadata.len(), metadata.modified().unwrap()));
        Self { path: database.to_owned(), state }
    }
}
