//! Interrupted and started again, it goes on where it was, and ends where it would have.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;

use serde_json::Value;

use crate::runs::{SMALL, folder, report, reproduce, told};

const ALL: [&str; 3] = ["--events", "events.csv", "--no-safety"];

/// The report without the times it took.
fn timeless(mut report: Value) -> Value {
    for method in report["methods"].as_object_mut().unwrap().values_mut() {
        method["train_events_per_s"].take();
        for seed in method["per_seed"].as_array_mut().unwrap() {
            seed["train_events_per_s"].take();
        }
    }
    report.as_object_mut().unwrap().remove("seconds");
    report
}

fn stages(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder.join("out/stages")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.strip_suffix(".stage").is_some()).collect()
}

#[test]
fn a_run_that_was_killed_goes_on_and_says_so() {
    let (undisturbed, killed) = (folder(20), folder(20));
    let output = reproduce(undisturbed.path(), &ALL).args(SMALL).output().unwrap();
    let expected = timeless(report(undisturbed.path(), &output));

    let small = || reproduce(killed.path(), &["--checkpoint-s", "0"]);
    let mut child = small().args(ALL).args(SMALL).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.starts_with("[3/")), "it tells each stage");
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!killed.path().join("out/report.json").exists());
    let output = small().args(ALL).args(SMALL).output().unwrap();
    assert!(told(&output).contains("stages are there already"), "{}", told(&output));
    assert_eq!(timeless(report(killed.path(), &output)), expected);

    fs::remove_file(killed.path().join("out/report.json")).unwrap();
    let output = small().args(ALL).args(SMALL).output().unwrap();
    let told_there = told(&output);
    let there: Vec<_> = told_there.lines().filter(|line| line.ends_with("stages are there already")).collect();
    assert_eq!(there.len(), 2, "for the search and for the tables: {told_there}");
    for line in there {
        let words: Vec<_> = line.split(' ').collect();
        assert_eq!(words[0], words[2], "all of them: {line}");
    }
    assert!(!told(&output).contains("events/s"), "nothing is learned again: {}", told(&output));
    assert_eq!(timeless(report(killed.path(), &output)), expected);
}

#[test]
fn half_a_stage_is_not_lost() {
    let folder = folder(20);
    let one = ["--methods", "naive", "--seeds", "1", "--steps", "40", "--hidden", "4", "--set", "minibatch=1"];
    let run = |arguments: &[&str]| {
        let mut command = reproduce(folder.path(), &["--checkpoint-s", "0"]);
        command.args(ALL).args(one).args(arguments);
        command
    };
    // A folder in the way of what a stage is kept in: it stops after its last update, and leaves its checkpoint.
    let output = run(&["--epochs", "1"]).output().unwrap();
    let expected = timeless(report(folder.path(), &output));
    let names = stages(folder.path());
    let kept: Vec<_> =
        names.iter().map(|name| fs::read(folder.path().join("out/stages").join(name)).unwrap()).collect();
    for name in &names {
        let path = folder.path().join("out/stages").join(name);
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
    }
    let output = run(&["--epochs", "1"]).output().unwrap();
    assert!(!output.status.success() && told(&output).contains("cannot write"), "{}", told(&output));
    assert_eq!(
        fs::read_dir(folder.path().join("out/stages"))
            .unwrap()
            .flatten()
            .filter(|e| e.path().extension().is_some_and(|x| x == "half"))
            .count(),
        1
    );
    for name in &names {
        fs::remove_dir(folder.path().join("out/stages").join(name)).unwrap();
    }
    let output = run(&["--epochs", "1"]).output().unwrap();
    assert_eq!(timeless(report(folder.path(), &output)), expected);
    assert_eq!(stages(folder.path()).len(), kept.len());
}

#[test]
fn damaged_and_foreign_stages_are_said_and_not_used() {
    let folder = folder(20);
    let run = |arguments: &[&str]| {
        let mut command = reproduce(folder.path(), &["--methods", "naive"]);
        command.args(ALL).args(SMALL).args(arguments);
        command.output().unwrap()
    };
    let output = run(&[]);
    let expected = timeless(report(folder.path(), &output));
    let damaged = folder.path().join("out/stages").join(&stages(folder.path())[0]);
    fs::write(&damaged, "not a stage").unwrap();
    let output = run(&[]);
    assert!(told(&output).contains("is damaged"), "{}", told(&output));
    assert_eq!(timeless(report(folder.path(), &output)), expected);
    let output = run(&["--set", "learning_rate=0.01"]);
    assert!(told(&output).contains("6 stages in the folder are of other events, other settings"), "{}", told(&output));
    assert_ne!(timeless(report(folder.path(), &output)), expected);
}
