//! The paper's experiment as arithmetic: which events make which task, which side each is on, what a table of errors says,
//! and how sure it is.

mod bootstrap;
mod by_run;
mod measures;
mod quantile;
mod search;
mod sides;
mod stage_search;
mod tally;
mod tasks;

pub use bootstrap::{Bootstrap, Draw};
pub use by_run::by_run;
pub use measures::{Measures, pooled};
pub use quantile::quantile;
pub use search::{Candidate, SEARCH_RULE, Weighed, best, best_of};
pub use sides::{at_random, missing_side};
pub use stage_search::{stage_diagonal, weigh_stage};
pub use tally::{Measure, Tally};
pub use tasks::{Tasks, TasksError};
