//! Where a command does its work: in a database that nobody serves, or at a server.

use std::path::{Path, PathBuf};

use clap::Args;

use super::service::{Opened, ServerArguments, Service};
use super::waiting::block_on;

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
    /// Asks what answers there; a database is opened as said, and closed again.
    pub(super) fn ask<T>(
        &self,
        opened: Opened,
        ask: impl AsyncFnOnce(&Service) -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        block_on(async {
            let service = match self.server()? {
                Some(server) => server,
                None => Service::inside(self.database(), opened).await?,
            };
            let asked = ask(&service).await;
            service.close().await;
            asked
        })
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
