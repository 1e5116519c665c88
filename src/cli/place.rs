//! Where a command does its work: in a database that nobody serves, or at a server.

use std::path::{Path, PathBuf};

use clap::Args;

use super::remote::{Remote, ServerArguments};

/// A database file or a server.
#[derive(Debug, Args)]
pub(super) struct Place {
    /// The database file, while no server has it open [default: ./headway.db]
    #[arg(long, value_name = "FILE")]
    database: Option<PathBuf>,
    #[command(flatten)]
    server: ServerArguments,
}

impl Place {
    /// The server, where one is named.
    pub(super) fn server(&self) -> anyhow::Result<Option<Remote>> {
        self.server.remote()
    }

    /// The file, where one is named.
    pub(super) fn database(&self) -> Option<&Path> {
        self.database.as_deref()
    }
}
