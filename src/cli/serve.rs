//! `headway serve`: the server.

use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use rustix::process::{Resource, Rlimit, Signal, getrlimit, setrlimit};
use tokio::net::TcpListener;
use tokio::signal::unix::{self, SignalKind};

use super::settings;
use crate::app;
use crate::config::{Config, Layer};
use crate::telemetry;

/// What `headway serve` can be told; everything else is in the settings.
#[derive(Debug, Args)]
pub(super) struct ServeArguments {
    /// Address and port to listen on; port 0 picks a free one [default: 127.0.0.1:8080]
    #[arg(long, value_name = "HOST:PORT")]
    listen: Option<SocketAddr>,
    /// The database file; created when it is absent [default: ./headway.db]
    #[arg(long, value_name = "FILE")]
    database: Option<PathBuf>,
    /// A TOML file of settings (see --print-settings)
    #[arg(long, value_name = "FILE", env = "HEADWAY_CONFIG")]
    config: Option<PathBuf>,
    /// One setting, as often as needed: --set model.hidden=64
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    settings: Vec<String>,
    /// Print every setting with its default and meaning, and exit
    #[arg(long)]
    print_settings: bool,
}

impl ServeArguments {
    pub(super) fn resolve(&self) -> anyhow::Result<Config> {
        let mut layers = settings::layers(self.config.as_deref())?;
        for setting in &self.settings {
            let (key, value) =
                setting.split_once('=').with_context(|| format!("--set {setting}: SECTION.KEY=VALUE is needed"))?;
            layers.push(Layer::one("--set", key.trim(), value.trim()));
        }
        if let Some(address) = self.listen {
            layers.push(Layer::string("--listen", "server.listen", &address.to_string()));
        }
        layers.extend(self.database.as_deref().map(settings::database).transpose()?);
        Ok(Config::resolve(layers)?)
    }
}

/// Serves until SIGTERM or SIGINT.
pub(super) fn run(arguments: &ServeArguments) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout();
    if arguments.print_settings {
        return Ok(stdout.write_all(crate::config::DEFAULTS.as_bytes())?);
    }
    let config = arguments.resolve()?;
    telemetry::start_logging(&config.log).context("log.filter")?;
    telemetry::log_panics();
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    if config.server.threads > 0 {
        runtime.worker_threads(config.server.threads);
    }
    let runtime = runtime.enable_all().build()?;
    allow_open_files();
    let served = runtime.block_on(async {
        let listen = config.server.listen;
        let listener = TcpListener::bind(listen).await.with_context(|| format!("cannot listen on {listen}"))?;
        let signal = signals()?;
        let scheme = config.server.tls.scheme();
        // With a handler, a file that may not grow any more is an error of the write, not the end of the process.
        let _too_large = signal_of(Signal::XFSZ)?;
        let announce = |address: SocketAddr| -> std::io::Result<()> {
            writeln!(stdout, "listening on {scheme}://{address}")?;
            stdout.flush()
        };
        app::serve(listener, config, announce, signal).await
    });
    // What still computes after the drain is not waited for.
    runtime.shutdown_background();
    served
}

/// Raises the limit on open files as far as the system lets it: every connection is one.
fn allow_open_files() {
    let limit = getrlimit(Resource::Nofile);
    if setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit }).is_err() {
        tracing::warn!(files = limit.current, "the limit on open files cannot be raised");
    }
}

fn signal_of(signal: Signal) -> std::io::Result<unix::Signal> {
    unix::signal(SignalKind::from_raw(signal.as_raw()))
}

/// Resolves at the first SIGTERM or SIGINT.
pub(super) fn signals() -> std::io::Result<impl Future<Output = ()>> {
    let (mut terminate, mut interrupt) = (signal_of(Signal::TERM)?, signal_of(Signal::INT)?);
    Ok(async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
    })
}
