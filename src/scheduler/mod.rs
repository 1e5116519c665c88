//! Which task runs when: triggers, the queue, the learn job.
//!
//! One task runs at a time per model, `parallel_tasks` in all, in the order of their ids within a model. Everything that
//! outlives the process is in the store; here is only what runs now and how to stop it. Stages that are learned again after a
//! retraction are tasks like any other, before all that wait; the replay they belong to comes after them and measures.
//! [`tick`](crate::scheduler::Scheduler::tick) is one turn, which a test can make by hand;
//! [`run`](crate::scheduler::Scheduler::run) makes them for the server.

mod error;
mod handle;
mod importance;
mod job;
mod learner;
mod observer;
mod priority;
mod replay;
mod retrain;
mod running;
mod search;
mod settings;
mod stage;
#[cfg(test)]
mod tests;
mod tick;
mod triggers;
mod verdict;

pub use handle::Scheduler;
pub use importance::summary as importance_summary;
pub use learner::{Learner, Training};
pub use priority::step_back;
pub use retrain::{RetrainError, Retrained, retrain};
pub use running::{SearchPlace, TaskProgress};
pub use search::SearchState;
pub use settings::{MOST_THREADS, SchedulerSettings};
pub use tick::TickOutcome;
