//! The real binary as a child process that goes with its owner.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// A server in a process of its own.
pub(crate) struct Binary {
    child: Child,
    /// What it says it listens on.
    pub(crate) url: String,
}

impl Binary {
    /// Starts it and waits until it listens.
    pub(crate) fn start(arguments: &[&str]) -> Self {
        Self::of(Command::new(env!("CARGO_BIN_EXE_headway")).args(arguments).stderr(Stdio::null()))
    }

    /// Starts it with these fail points and its log in a file, and waits until it listens.
    pub(crate) fn start_with_log(arguments: &[&str], points: &str, log: File) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
        Self::of(command.args(arguments).env("FAILPOINTS", points).env_remove("RUST_BACKTRACE").stderr(log))
    }

    fn of(command: &mut Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut first = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
        let url = first.trim().strip_prefix("listening on ").unwrap_or_else(|| panic!("it says {first:?}")).to_owned();
        Self { child, url }
    }

    pub(crate) fn pid(&self) -> u32 {
        self.child.id()
    }
}

impl Drop for Binary {
    fn drop(&mut self) {
        // It may have gone already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
