//! Learning, from outside: against PyTorch, against itself, and against forgetting.

mod golden;
mod stages;
