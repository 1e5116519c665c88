//! `headway demo`, the real binary: the story is told from what comes out of it.

#![allow(clippy::unwrap_used, reason = "what a test expects, said in the shortest way")]

use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use headway::car_following::{TrafficRegime, TrafficSettings, generate};
use serde_json::{Value, json};

/// Small and quick: a demo of seconds, whose models are worth nothing.
const SMALL: [&str; 6] = ["--hidden", "8", "--epochs", "1", "--events-per-regime", "40"];

/// The demo with its temporary files in `folder`.
fn demo(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    command.arg("demo").args(["--listen", "127.0.0.1:0"]).args(arguments);
    command.current_dir(folder).env("TMPDIR", folder).env("RUST_BACKTRACE", "1").stdin(Stdio::null());
    command
}

fn told(output: &Output) -> (&str, &str) {
    (std::str::from_utf8(&output.stdout).unwrap(), std::str::from_utf8(&output.stderr).unwrap())
}

/// The one JSON object of a run that did its work.
#[track_caller]
fn result(output: &Output) -> Value {
    let (stdout, stderr) = told(output);
    assert!(output.status.success(), "{stderr}");
    assert_eq!(stdout.lines().count(), 1, "{stdout}");
    serde_json::from_str(stdout).unwrap()
}

/// Three stages of both models, and every number that there can be.
#[track_caller]
fn assert_whole(result: &Value) {
    assert_eq!(result["tasks"], json!(["fast", "middle", "slow"]));
    for (model, told) in result["models"].as_object().unwrap() {
        let stages: Vec<_> = told["stages"].as_array().unwrap().iter().map(|s| (&s["stage"], &s["version"])).collect();
        assert_eq!(stages, [(&json!(1), &json!(1)), (&json!(2), &json!(2)), (&json!(3), &json!(3))], "{model}");
        for table in ["spacing_mse", "speed_mse", "collision_rate_percent"] {
            for (stage, row) in told[table].as_array().unwrap().iter().enumerate() {
                let known: Vec<_> = row.as_array().unwrap().iter().map(Value::is_number).collect();
                assert_eq!(known, [true, stage >= 1, stage >= 2], "{table} of {model}: {row}");
            }
        }
        let [fast, middle] = [0, 1].map(|of| {
            let at = |stage: usize| told["spacing_mse"][stage][of].as_f64().unwrap();
            at(2) / at(of)
        });
        assert_eq!(told["forgetting_ratio"], json!([fast, middle]), "{model}");
    }
    assert_eq!(result["models"].as_object().unwrap().len(), 2);
    assert_eq!(result["models"]["ewc"]["spacing_mse"][0], result["models"]["naive"]["spacing_mse"][0], "bit-equal");
}

#[test]
fn the_demo_learns_compares_and_rolls_back() {
    let folder = tempfile::tempdir().unwrap();
    let output = demo(folder.path(), &SMALL).args(["--exit", "--json", "--seed", "7"]).output().unwrap();
    let result = result(&output);
    assert_whole(&result);
    assert_eq!((&result["seed"], &result["split_mps"]), (&json!(7), &Value::Null));
    for stage in 0..3 {
        assert_eq!(result["models"]["naive"]["uploads"][stage]["accepted"], json!(40));
    }
    let rollback = &result["rollback"];
    assert_eq!((&rollback["from"], &rollback["live"], &rollback["head"]), (&json!(3), &json!(2), &json!(2)));
    let (before, after) = (&result["predicted_before"], &result["predicted_after"]);
    assert_eq!((&before["version"], &after["version"]), (&json!(3), &json!(2)));
    assert_ne!(before["predictions"][0]["accel_mps2"], after["predictions"][0]["accel_mps2"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
}

#[test]
fn a_reader_gets_tables_and_no_log() {
    let folder = tempfile::tempdir().unwrap();
    let output = demo(folder.path(), &SMALL).args(["--exit", "--database", "kept.db"]).output().unwrap();
    let (stdout, stderr) = told(&output);
    assert!(output.status.success(), "{stderr}");
    for part in [
        "Stage 1: fast traffic",
        "Stage 3: slow traffic",
        "Spacing, mean squared error, m²",
        "after middle",
        "Forgetting: last spacing error / error when just learned",
        "version 2 of ewc answers",
        "Done in",
    ] {
        assert!(stdout.contains(part), "{part} is missing in:\n{stdout}");
    }
    assert!(!stdout.contains("curl"), "with --exit there is nothing to try:\n{stdout}");
    assert!(stderr.lines().all(|line| line.contains(", epoch ")), "progress and nothing else:\n{stderr}");
    assert!(folder.path().join("kept.db").exists());
}

/// Killed when the test does not get to its end.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A POST or GET as the line says it; `sh` and `curl` need not be there.
async fn pasted(line: &str) -> (u16, Value) {
    let url = line.split(' ').find(|part| part.starts_with("http://")).unwrap();
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    let request = match line.split_once(" -d ") {
        Some((head, body)) => {
            assert!(head.ends_with(" -H 'Content-Type: application/json'"), "{line}");
            let body = body.strip_prefix('\'').and_then(|body| body.strip_suffix('\'')).unwrap();
            client.post(url).header("content-type", "application/json").body(body.to_owned())
        }
        None => client.get(url),
    };
    let response = request.send().await.unwrap();
    (response.status().as_u16(), serde_json::from_str(&response.text().await.unwrap()).unwrap())
}

#[tokio::test]
async fn the_server_goes_on_and_answers_what_the_demo_says_to_try() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = demo(folder.path(), &SMALL);
    let mut running = Running(command.arg("--json").stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap());
    let mut stdout = BufReader::new(running.0.stdout.take().unwrap());
    let mut line = String::new();
    stdout.read_line(&mut line).unwrap();
    let result: Value = serde_json::from_str(&line).unwrap();
    let mut answers = Vec::new();
    for line in result["curl"].as_array().unwrap() {
        let (status, body) = pasted(line.as_str().unwrap()).await;
        assert_eq!(status, 200, "{line}: {body}");
        answers.push(body);
    }
    let [predicted, evaluation, history] = answers.as_slice() else { panic!("three lines: {answers:?}") };
    let accel = "/predictions/0/accel_mps2";
    assert_eq!(predicted.pointer(accel).unwrap(), result["predicted_after"].pointer(accel).unwrap());
    assert_eq!(evaluation["tasks"][2]["spacing_mse"], result["models"]["naive"]["spacing_mse"][2][2]);
    let last = history["history"].as_array().unwrap().last().unwrap();
    assert_eq!((&last["action"], &last["live"]), (&json!("rollback"), &json!(2)));

    let pid = running.0.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    assert!(running.0.wait().unwrap().success());
    let mut rest = String::new();
    stdout.read_to_string(&mut rest).unwrap();
    assert_eq!(rest, "");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
}

/// Generated events in the columns that recordings come in; of each regime the first event has a vehicle that jumps.
fn recorded_csv(events: usize) -> String {
    let mut csv = "event_id,source,pair,run,follower,t,spacing,sv_speed,lv_speed,rel_speed\n".to_owned();
    for regime in TrafficRegime::ALL {
        for (number, drive) in generate(regime, 5, events, &TrafficSettings::default()).into_iter().enumerate() {
            let event = &drive.event;
            for step in 0..event.steps() {
                let (follower, leader) = (event.follower_speed_mps()[step], event.leader_speed_mps()[step]);
                let spacing = event.spacing_m()[step] + if number == 0 && step > 50 { 30.0 } else { 0.0 };
                let (id, run, t) = (&drive.event_id, &drive.run, step as f64 * event.dt_s());
                let rel = leader - follower;
                writeln!(csv, "{id},test,p,{run},human,{t:.1},{spacing},{follower},{leader},{rel}").unwrap();
            }
        }
    }
    csv
}

#[test]
fn recorded_events_become_tasks_by_speed_and_bad_ones_are_told() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("recorded.csv"), recorded_csv(50)).unwrap();
    let output = demo(folder.path(), &SMALL).args(["--exit", "--json", "--events", "recorded.csv"]).output().unwrap();
    let result = result(&output);
    assert_whole(&result);
    let [low, high] = [0, 1].map(|edge| result["split_mps"][edge].as_f64().unwrap());
    assert!((7.4..8.6).contains(&low) && (12.4..13.6).contains(&high), "between the generator's bands: {low}, {high}");
    assert_eq!(result["left_out"], json!([10, 10, 10]));
    for upload in result["models"]["ewc"]["uploads"].as_array().unwrap() {
        assert_eq!((&upload["accepted"], &upload["rejected_count"]), (&json!(39), &json!(1)), "{upload}");
    }
}

#[test]
fn what_cannot_be_shown_is_said_and_ends_with_an_error() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("few.csv"), recorded_csv(5)).unwrap();
    fs::write(folder.path().join("other.csv"), "event_id,speed\n1,2\n").unwrap();
    fs::write(folder.path().join("mine.db"), "precious").unwrap();
    for (arguments, reason) in [
        (&["--events", "few.csv"][..], "only 5 events are fast traffic"),
        (&["--events", "other.csv"], "unknown column \"speed\""),
        (&["--events", "absent.csv"], "cannot read absent.csv"),
        (&["--events", "few.xml"], ".parquet, .csv, .json and .ndjson"),
        (&["--database", "mine.db"], "mine.db exists"),
        (&["--hidden", "0"], "hidden: 0 is not within"),
        (&["--events-per-regime", "3"], "3 is not in 20..="),
    ] {
        let output = demo(folder.path(), arguments).args(["--exit", "--json"]).output().unwrap();
        let (stdout, stderr) = told(&output);
        assert!(!output.status.success() && stdout.is_empty(), "{arguments:?}: {stdout}");
        assert!(stderr.contains(reason), "{arguments:?}: {stderr}");
        assert!(!stderr.contains("backtrace"), "for a person, not for a debugger: {stderr}");
    }
    assert_eq!(fs::read_to_string(folder.path().join("mine.db")).unwrap(), "precious");
    assert!(!folder.path().join("mine.db.lock").exists());
}
