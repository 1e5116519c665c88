//! The command line, run as somebody runs it.

use std::process::Command;

use serde_json::Value;

/// What a command said, and whether it did its work.
#[derive(Debug)]
pub(crate) struct Said {
    pub success: bool,
    pub out: String,
    pub err: String,
}

impl Said {
    /// What it printed, when it did its work.
    #[track_caller]
    pub(crate) fn done(self) -> String {
        assert!(self.success, "{}", self.err);
        self.out
    }

    /// As [`Self::done`], read as JSON.
    #[track_caller]
    pub(crate) fn json(self) -> Value {
        serde_json::from_str(&self.done()).unwrap()
    }

    /// Why it did not do its work.
    #[track_caller]
    pub(crate) fn refused(self) -> String {
        assert!(!self.success, "{}", self.out);
        self.err
    }
}

/// Runs `headway` with these variables, and none of whoever runs the tests.
pub(crate) fn headway_with(variables: &[(&str, &str)], arguments: &[&str]) -> Said {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("HEADWAY_")) {
        command.env_remove(name);
    }
    let output = command.envs(variables.iter().copied()).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Said { success: output.status.success(), out: text(output.stdout), err: text(output.stderr) }
}

/// Runs `headway`.
pub(crate) fn headway(arguments: &[&str]) -> Said {
    headway_with(&[], arguments)
}
