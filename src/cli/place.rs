//! Where a command does its work: in a database that nobody serves, or at a server.

use std::path::{Path, PathBuf};

use clap::Args;

use super::service::{Opened, ServerArguments, Service};

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
    /// What answers there; a database is opened as said.
    pub(super) async fn service(&self, opened: Opened) -> anyhow::Result<Service> {
        match self.server()? {
            Some(server) => Ok(server),
            None => Service::inside(self.database(), opened).await,
        }
    }

    /// The server, where one is named.
    pub(super) fn server(&self) -> anyhow::Result<Option<Service>> {
        self.server.service()
    }

    /// The file, where one is named.
    pub(super) fn database(&self) -> Option<&Path> {
        self.database.as_deref()
    }
}
