//! The server: the one that `headway serve` runs, in this process, on a database of its own.

use std::net::SocketAddr;
use std::path::Path;

use anyhow::{Context, bail};
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

use super::DemoArguments;
use crate::app;
use crate::config::{Config, Layer};
use crate::scheduler::MOST_THREADS;

/// Where a server listens that is not told where.
const USUAL: &str = "127.0.0.1:8080";

/// A running server.
pub(super) struct DemoServer {
    url: String,
    /// What a reader should know about where it listens and where its database is.
    place: String,
    serving: JoinHandle<anyhow::Result<()>>,
    stop: oneshot::Sender<()>,
    /// Goes with the server.
    folder: Option<TempDir>,
}

impl DemoServer {
    /// Starts it; it answers requests when this returns.
    pub(super) async fn start(arguments: &DemoArguments) -> anyhow::Result<Self> {
        let folder = match &arguments.database {
            Some(path) => {
                refuse_existing(path)?;
                None
            }
            None => Some(tempfile::tempdir().context("cannot make a temporary folder")?),
        };
        let temporary = folder.as_ref().map(|folder| folder.path().join("headway.db"));
        let database = temporary.as_ref().or(arguments.database.as_ref()).expect("one of the two");
        // Resolved before listening, so that a forbidden address is refused.
        let config = config(arguments.listen, database)?;
        let (listener, moved) = listen(arguments.listen).await?;
        let (stop, stopped) = oneshot::channel();
        let (ready, address) = oneshot::channel::<SocketAddr>();
        let announce = |address| ready.send(address).map_err(|_| std::io::Error::other("nobody waits for the server"));
        let serving = tokio::spawn(app::serve(listener, config, announce, async {
            let _ = stopped.await;
        }));
        let Ok(address) = address.await else {
            serving.await??;
            bail!("the server ended at once");
        };
        let kept = match &arguments.database {
            Some(path) => format!("its database is {}", path.display()),
            None => "its database goes when the demo ends".to_owned(),
        };
        let moved = if moved { format!(" ({USUAL} is taken)") } else { String::new() };
        let url = format!("http://{address}");
        let place = format!("{url}{moved}; {kept}");
        Ok(Self { url, place, serving, stop, folder })
    }

    pub(super) fn url(&self) -> &str {
        &self.url
    }

    pub(super) fn place(&self) -> &str {
        &self.place
    }

    /// Resolves when the server ends by itself, which it should not.
    pub(super) async fn ended(&mut self) -> anyhow::Result<()> {
        (&mut self.serving).await?
    }

    /// Lets it end as after SIGTERM, and removes what was temporary.
    pub(super) async fn stop(self) -> anyhow::Result<()> {
        let _ = self.stop.send(());
        self.serving.await??;
        if let Some(folder) = self.folder {
            folder.close().context("cannot remove the temporary folder")?;
        }
        Ok(())
    }
}

/// A demonstration must not end up in a database that somebody uses.
fn refuse_existing(path: &Path) -> anyhow::Result<()> {
    if path.exists() {
        let shown = path.display();
        bail!("{shown} exists, and the demo wants a new file; headway serve --database {shown} serves what is in it");
    }
    Ok(())
}

/// The settings of every server, but that nothing else here wants the processor, and that the log is for trouble.
fn config(listen: Option<SocketAddr>, database: &Path) -> anyhow::Result<Config> {
    let database = database.to_str().context("--database: the path is not UTF-8")?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(MOST_THREADS);
    let mut layers = vec![
        Layer::string("--database", "database.path", database),
        Layer::one("headway demo", "training.training_threads", &threads.to_string()),
        Layer::string("headway demo", "log.filter", "warn"),
    ];
    if let Some(address) = listen {
        layers.push(Layer::string("--listen", "server.listen", &address.to_string()));
    }
    Ok(Config::resolve(layers)?)
}

/// A listener, and whether it is elsewhere than usual because that is taken.
async fn listen(wanted: Option<SocketAddr>) -> anyhow::Result<(TcpListener, bool)> {
    if let Some(address) = wanted {
        let listener = TcpListener::bind(address).await;
        return Ok((listener.with_context(|| format!("cannot listen on {address}"))?, false));
    }
    match TcpListener::bind(USUAL).await {
        Ok(listener) => Ok((listener, false)),
        Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => {
            let listener = TcpListener::bind("127.0.0.1:0").await;
            Ok((listener.context("cannot listen on any port of 127.0.0.1")?, true))
        }
        Err(error) => Err(error).with_context(|| format!("cannot listen on {USUAL}")),
    }
}
