//! The command line. One module per subcommand; without one, `headway` serves.

/// How far a task is, on stderr.
mod advance;
/// A model as a file.
mod archive;
/// What most commands are told.
mod asked;
/// A copy of a database.
mod backup;
/// How fast it is.
mod bench;
/// A database without what it does not use.
mod compact;
/// The whole main job, shown.
mod demo;
/// Drivers on events that are not kept.
mod evaluate;
/// Event files as bodies.
mod event_file;
/// Files out of a model.
mod export;
/// Made-up events.
mod generate;
/// Whether a server can serve.
mod healthy;
/// Event files into a model.
mod import;
/// Who may use a server.
mod keys;
/// How far a look at a database is, on stderr.
mod looking;
/// What shells and `man` know.
mod manual;
/// How drivers do, as a table.
mod measures;
/// Members of answers in tables.
mod member;
/// Models.
mod models;
/// Which version serves.
mod moving;
/// Event files.
mod recordings;
/// Where the work is.
mod place;
/// What a version would do.
mod predict;
/// The paper's experiment, from event files to its tables and figures.
mod reproduce;
/// A copy in the place of a database.
mod restore;
/// The server.
mod serve;
/// What answers.
mod service;
/// What a server would find.
mod settings;
/// Tables for people.
mod table;
/// Learning.
mod train;
/// Whether a database is what was written.
mod verify;
/// What was learned.
mod versions;
/// What a command waits for.
mod waiting;

use clap::{CommandFactory, Parser, Subcommand};

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
    /// Print made-up events, to try things with.
    Generate(generate::GenerateArguments),
    /// Take events from files into a model, as an upload does.
    Import(import::ImportArguments),
    /// Learn what is pending, and tell what came of it.
    Train(train::TrainArguments),
    /// List versions, or tell how one drives.
    Versions(versions::VersionsArguments),
    /// Let a version serve.
    Promote(moving::PromoteArguments),
    /// Go back to an earlier version, serving and learning.
    Rollback(moving::RollbackArguments),
    /// Predict the next accelerations of windows.
    Predict(predict::PredictArguments),
    /// Drive a follower behind a leader.
    Simulate(predict::SimulateArguments),
    /// Compare versions and drivers out of the literature on events that are not kept.
    Evaluate(evaluate::EvaluateArguments),
    /// List models, or make one.
    Models(models::ModelsArguments),
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
    /// Print a script that completes this command line in a shell.
    Completions(manual::CompletionsArguments),
    /// Write pages for `man`.
    Manual(manual::ManualArguments),
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
        Command::Generate(arguments) => generate::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Train(arguments) => train::run(&arguments),
        Command::Versions(arguments) => versions::run(&arguments),
        Command::Promote(arguments) => moving::promote(&arguments),
        Command::Rollback(arguments) => moving::rollback(&arguments),
        Command::Predict(arguments) => predict::predict(&arguments),
        Command::Simulate(arguments) => predict::simulate(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Models(arguments) => models::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Compact(arguments) => compact::run(&arguments),
        Command::Keys(arguments) => keys::run(arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Backup(arguments) => backup::run(&arguments),
        Command::Archive(arguments) => archive::run(&arguments),
        Command::Restore(arguments) => restore::run(&arguments),
        Command::Healthy(arguments) => healthy::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Completions(arguments) => manual::complete(&arguments, Arguments::command()),
        Command::Manual(arguments) => manual::write(&arguments, Arguments::command()),
    }
}
