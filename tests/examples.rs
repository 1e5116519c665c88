//! The examples of the interface work, and leave out no call of the contract.

#![expect(clippy::unwrap_used, reason = "helpers of tests say what they expect in the shortest way, as tests do")]
#![expect(clippy::print_stderr, reason = "says what was not there to look with")]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

#[path = "support/binary.rs"]
#[expect(dead_code, reason = "other tests want its log, or its process")]
mod binary;
#[path = "support/contract.rs"]
#[expect(dead_code, reason = "other tests hold answers to it")]
mod contract;

use binary::Binary;

fn examples() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("api/examples");
    let mut found: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    found.retain(|path| path.extension().is_some_and(|extension| extension == "sh"));
    found.sort();
    found
}

/// What `headway generate` prints.
fn traffic(regime: &str) -> Vec<u8> {
    let said =
        Command::new(env!("CARGO_BIN_EXE_headway")).args(["generate", regime, "--events", "24"]).output().unwrap();
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    said.stdout
}

/// Method and path template of every call that was answered well, as the server counted them.
fn answered_well(metrics: &str) -> BTreeSet<(String, String)> {
    let label = |line: &str, name: &str| {
        let value = line.split(&format!("{name}=\"")).nth(1).unwrap();
        value.split('"').next().unwrap().to_owned()
    };
    let counted = metrics.lines().filter(|line| line.starts_with("headway_http_requests_total{"));
    counted
        .filter(|line| label(line, "status").starts_with('2'))
        .map(|line| (label(line, "method"), label(line, "route")))
        .collect()
}

fn is_there(program: &str) -> bool {
    Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

#[test]
fn the_examples_make_every_call_of_the_contract_and_none_fails() {
    if let Some(missing) = ["bash", "curl", "gzip"].into_iter().find(|program| !is_there(program)) {
        eprintln!("skipped: {missing} is not here");
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name);
    for regime in ["fast", "slow"] {
        fs::write(file(&format!("{regime}.csv")), traffic(regime)).unwrap();
    }
    let (database, backups) = (file("headway.db"), format!("backup.folder={}", file("backups").display()));
    let place = ["--listen", "127.0.0.1:0", "--database", database.to_str().unwrap(), "--set", &backups];
    let server = Binary::start(&place);
    let run = |command: &mut Command| {
        let output = command.current_dir(directory.path()).env("HEADWAY_URL", &server.url).output().unwrap();
        let (told, said) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success(), "{command:?}: {}\n{told}\n{said}", output.status);
        told.into_owned()
    };
    for example in examples() {
        run(Command::new("bash").args(["-euo", "pipefail"]).arg(&example));
    }
    let key = serde_json::from_slice::<serde_json::Value>(&fs::read(file("admin.json")).unwrap()).unwrap();
    let bearer = format!("Authorization: Bearer {}", key["key"].as_str().unwrap());
    let metrics = run(Command::new("curl").args(["-sS", "--fail", "-H", &bearer, &format!("{}/metrics", server.url)]));
    let well = answered_well(&metrics);
    let asked = |(path, method, _): &(&str, String, _)| well.contains(&(method.clone(), (*path).to_owned()));
    let left_out: Vec<_> = contract::operations()
        .into_iter()
        .filter(|call| !asked(call))
        .map(|(path, method, _)| format!("{method} {path}"))
        .collect();
    assert_eq!(left_out, Vec::<String>::new(), "no example makes these calls well");
}
