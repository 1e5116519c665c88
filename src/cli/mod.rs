//! The command line. One module per subcommand; without one, `headway` serves.

/// A model as a file.
mod archive;
/// A copy of a database.
mod backup;
/// How fast it is.
mod bench;
/// A database without what it does not use.
mod compact;
/// The whole main job, shown.
mod demo;
/// Files out of a model.
mod export;
/// Whether a server can serve.
mod healthy;
/// Event files into a model.
mod import;
/// Who may use a server.
mod keys;
/// How far a look at a database is, on stderr.
mod looking;
/// Members of answers in tables.
mod member;
/// Event files.
mod recordings;
/// Where the work is.
mod place;
/// A running server.
mod remote;
/// The paper's experiment, from event files to its tables and figures.
mod reproduce;
/// A copy in the place of a database.
mod restore;
/// The server.
mod serve;
/// What a server would find.
mod settings;
/// Whether a database is what was written.
mod verify;

use clap::{Parser, Subcommand};

/// Continual learning of car-following models as a service.
#[derive(Debug, Parser)]
#[command(name = "headway", version, about, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    serve: serve::ServeArguments,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run the server (what `headway` without a subcommand does).
    Serve(serve::ServeArguments),
    /// Show the whole job: upload, learn in turn, compare, predict, roll back.
    Demo(demo::DemoArguments),
    /// Repeat the paper's experiment on event files: methods learned task by task, tables, intervals, figures.
    Reproduce(reproduce::ReproduceArguments),
    /// Take events from files into a model, as an upload does.
    Import(import::ImportArguments),
    /// Write events, evaluations and versions into files.
    Export(export::ExportArguments),
    /// Rewrite the database without what it does not use; the server must not run.
    Compact(compact::CompactArguments),
    /// Make, list and revoke the keys that a server asks for.
    Keys(keys::KeysArguments),
    /// Check a database: its pages, every digest, what always holds; learn versions again and compare.
    Verify(verify::VerifyArguments),
    /// Copy a database while a server may be writing to it.
    Backup(backup::BackupArguments),
    /// Put one model with everything it has into a file of its own, or take it out of one into another database.
    Archive(archive::ArchiveArguments),
    /// Put a copy in the place of a database.
    Restore(restore::RestoreArguments),
    /// Ask whether the server on this machine can serve, as the health check of a container does.
    Healthy(healthy::HealthyArguments),
    /// Measure how fast this machine learns and answers.
    Bench(bench::BenchArguments),
}

/// Reads the command line and does what it says.
///
/// # Errors
/// When the command could not do its work; the message is for a person.
pub fn run() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let _faults = fail::has_failpoints().then(fail::FailScenario::setup);
    match arguments.command.unwrap_or(Command::Serve(arguments.serve)) {
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Reproduce(arguments) => reproduce::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Compact(arguments) => compact::run(&arguments),
        Command::Keys(arguments) => keys::run(arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Backup(arguments) => backup::run(&arguments),
        Command::Archive(arguments) => archive::run(&arguments),
        Command::Restore(arguments) => restore::run(&arguments),
        Command::Healthy(arguments) => healthy::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
    }
}
