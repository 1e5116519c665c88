//! The swap of versions and the batcher, in orders of events that a scheduler chooses: the sources of `src/predictor` themselves,
//! compiled once more over locks and threads of [`shuttle`], which takes turns among them wherever they meet.
//!
//! `HEADWAY_SCHEDULES` says how many orders each test tries and `HEADWAY_SCHEDULE_SEED` which:
//! `HEADWAY_SCHEDULES=1000000 HEADWAY_SCHEDULE_SEED=7 cargo test --release --test schedules`.

#![allow(clippy::unwrap_used, reason = "what a test expects, said in the shortest way")]
#![allow(clippy::print_stdout, reason = "a test tells its seed and what it measured")]

use headway::{driver, evaluation};
use shuttle::scheduler::{PctScheduler, RandomScheduler};
use shuttle::{Config, Runner};

/// Requests that wait together.
mod company;
/// The predictor, over the locks and threads of a scheduler.
#[allow(dead_code, unreachable_pub, missing_docs, reason = "sources of the library, of which a test needs a part")]
mod predictor;
/// A store that knows which version was live when.
mod store;
/// Promotions, rollbacks and requests at once.
mod traffic;

fn variable(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().unwrap_or_else(|_| panic!("{name}={text} is no number")))
}

/// Tries many orders: some in which each turn is drawn, and some in which one of the tasks is kept back for long.
fn try_orders(scenario: fn()) {
    let seed = variable("HEADWAY_SCHEDULE_SEED").unwrap_or(42);
    let orders = variable("HEADWAY_SCHEDULES").map_or(2000, |orders| usize::try_from(orders).unwrap());
    println!("HEADWAY_SCHEDULE_SEED={seed} HEADWAY_SCHEDULES={orders}");
    Runner::new(RandomScheduler::new_from_seed(seed, orders / 2), Config::new()).run(scenario);
    Runner::new(PctScheduler::new_from_seed(seed, 3, orders.div_ceil(2)), Config::new()).run(scenario);
}
