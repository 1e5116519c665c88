use std::path::{Path, PathBuf};
use std::process::Command;

/// Builds a library to be preloaded from a source beside this one.
pub(crate) fn library(folder: &Path, source: &str) -> PathBuf {
    let library = folder.join("preloaded.so");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults").join(source);
    let mut compiler = Command::new(std::env::var_os("CC").unwrap_or_else(|| "cc".into()));
    compiler.args(["-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o"]).arg(&library).arg(source).arg("-ldl");
    assert!(compiler.status().unwrap().success(), "the C compiler that SQLite needs is there");
    library
}
