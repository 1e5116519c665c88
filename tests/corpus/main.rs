//! What fuzzing kept, and changes of it, through the functions that are fuzzed, without a fuzzer.
//!
//! `HEADWAY_FUZZ_TARGET` names the only target that is looked at, `HEADWAY_FUZZ_CHANGES` how many changes are made for each,
//! and `HEADWAY_FUZZ_SEED` which.

#![expect(clippy::print_stderr, reason = "tells of panics that are caught")]
#![expect(clippy::unwrap_used, reason = "a test says what it expects in the shortest way")]

#[path = "../../fuzz/src/targets/mod.rs"]
#[expect(unreachable_pub, reason = "a library where it is fuzzed")]
mod targets;
mod change;
mod seeds;

use std::panic::{catch_unwind, set_hook};
use std::path::Path;
use std::{env, fs};

use change::Changes;
use targets::{ALL, Target};

/// Files of the corpus: names and bytes, in the order of their names.
type Kept = Vec<(String, Vec<u8>)>;

fn kept(target: &Target) -> Kept {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target.name);
    let entries = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let read = |path: &Path| (path.display().to_string(), fs::read(path).unwrap());
    let mut files: Kept = entries.map(|entry| read(&entry.unwrap().path())).collect();
    files.sort();
    assert!(files.len() > 8, "{} has {} files", target.name, files.len());
    files
}

fn targets() -> impl Iterator<Item = &'static Target> {
    let only = env::var("HEADWAY_FUZZ_TARGET").ok();
    ALL.iter().filter(move |target| only.as_ref().is_none_or(|only| only == target.name))
}

/// Whether a target keeps its promises for these bytes. A panic of a library that is caught on the way is told in a line:
/// finding out where it was takes more memory than is allowed.
fn holds(target: &Target, bytes: &[u8]) -> bool {
    set_hook(Box::new(|panic| eprintln!("{panic}")));
    catch_unwind(|| (target.run)(bytes)).is_ok()
}

/// A number that the environment gives.
fn number(name: &str, otherwise: u64) -> u64 {
    env::var(name).map_or(otherwise, |text| text.parse().unwrap_or_else(|_| panic!("{name} is {text:?}, no number")))
}

#[test]
fn what_fuzzing_kept_breaks_no_promise() {
    let mut breaking = Vec::new();
    for target in targets() {
        for (name, bytes) in kept(target) {
            if !holds(target, &bytes) {
                breaking.push(name);
            }
        }
    }
    assert!(breaking.is_empty(), "{breaking:#?}");
}

#[test]
fn changes_of_what_fuzzing_kept_break_no_promise() {
    let (seed, count) = (number("HEADWAY_FUZZ_SEED", 1), number("HEADWAY_FUZZ_CHANGES", 400));
    for target in targets() {
        let kept = kept(target);
        let mut changes = Changes::new(seed, target.name);
        for nth in 0..count {
            let bytes = changes.next(&kept);
            let told = || format!("{}, change {nth} of seed {seed}: {}", target.name, bytes.escape_ascii());
            assert!(holds(target, &bytes), "{}", told());
        }
    }
}
