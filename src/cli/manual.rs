//! `headway completions` and `headway manual`: what a shell and `man` know of the command line.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;

/// What `headway completions` can be told.
#[derive(Debug, Args)]
pub(super) struct CompletionsArguments {
    /// For which shell
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

/// What `headway manual` can be told.
#[derive(Debug, Args)]
pub(super) struct ManualArguments {
    /// Write a page for every command into this folder, which is made; without it the page of headway goes to stdout
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
}

/// Prints a script that completes this command line.
pub(super) fn complete(arguments: &CompletionsArguments, mut command: Command) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, "headway", &mut script);
    Ok(std::io::stdout().write_all(&script)?)
}

/// Writes pages for `man`.
pub(super) fn write(arguments: &ManualArguments, command: Command) -> anyhow::Result<()> {
    let Some(folder) = &arguments.out else {
        return Ok(Man::new(command).render(&mut std::io::stdout())?);
    };
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    clap_mangen::generate_to(command, folder).with_context(|| format!("cannot write into {}", folder.display()))
}
