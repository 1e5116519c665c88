//! The `headway` binary; everything is in the library.

use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    match headway::cli::run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // For a person: what and why, without the stack that `Debug` adds where RUST_BACKTRACE is set.
            let _ = writeln!(std::io::stderr(), "Error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
