//! The command line does in a database that nobody serves what it does at a server.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::support::command::{Said, headway_with};
use crate::support::events::{event, events, window};
use crate::support::server::Server;
use crate::uploads::ndjson;

/// Settings of the server in the tests that what is learned depends on.
const VARIABLES: [(&str, &str); 7] = [
    ("HEADWAY_MODEL__HIDDEN", "6"),
    ("HEADWAY_MODEL__HORIZON", "5"),
    ("HEADWAY_MODEL__EPOCHS", "1"),
    ("HEADWAY_MODEL__MINIBATCH", "8"),
    ("HEADWAY_MODEL__SCHEDULE", "manual"),
    ("HEADWAY_MODEL__PROMOTION", "auto"),
    ("HEADWAY_TRAINING__TRAINING_THREADS", "1"),
];

/// Where a command does its work.
#[derive(Clone, Copy)]
struct Place<'a>(&'a [&'a str]);

impl Place<'_> {
    fn run(self, arguments: &[&str]) -> Said {
        headway_with(&VARIABLES, &[arguments, self.0].concat())
    }
}

/// Without what no two runs share.
fn timeless(mut answer: Value) -> Value {
    match &mut answer {
        Value::Object(members) => {
            members.retain(|name, _| !name.ends_with("_at"));
            members.values_mut().for_each(|member| *member = timeless(member.take()));
        }
        Value::Array(entries) => entries.iter_mut().for_each(|entry| *entry = timeless(entry.take())),
        _ => {}
    }
    answer
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path.to_str().unwrap().to_owned()
}

/// What every command answers while a model comes to be, learns two regimes, and is moved.
fn story(place: Place<'_>, folder: &Path) -> Vec<Value> {
    let mut told = Vec::new();
    let mut ask = |arguments: &[&str]| told.push(timeless(place.run(&[arguments, &["--json"]].concat()).json()));
    let model = ["--model", "m"];
    ask(&["models", "create", "m", "--method", "mas", "--set", "strength=2"]);
    for (regime, speed) in [("fast", 16.0), ("slow", 6.0)] {
        let mut sent = events(regime, 12, speed);
        sent.push(event(&format!("{regime} to validate"), speed, "validation"));
        let file = written(folder, &format!("{regime}.ndjson"), &ndjson(&sent));
        ask(&[&["import", &file, "--regime", regime], &model[..]].concat());
        ask(&[&["train", "--set", "epochs=2"], &model[..]].concat());
    }
    let window = window(5, 9.0);
    let windows = written(folder, "windows.json", json!([window, window]).to_string().as_bytes());
    let drive = json!({"initial": window, "leader_speed_mps": vec![9.0; 12]});
    let drive = written(folder, "drive.json", drive.to_string().as_bytes());
    let fast = folder.join("fast.ndjson").to_str().unwrap().to_owned();
    for arguments in [
        &["versions"][..],
        &["versions", "2"],
        &["predict", &windows],
        &["predict", &windows, "--version", "1"],
        &["simulate", &drive],
        &["evaluate", &fast, "--versions", "1,2", "--references", "idm,constant", "--regime", "fast"],
        &["rollback", "--reason", "tried"],
        &["promote", "2", "--reason", "better"],
    ] {
        ask(&[arguments, &model[..]].concat());
    }
    ask(&["models", "list"]);
    told
}

#[tokio::test(flavor = "multi_thread")]
async fn commands_answer_alike_in_a_database_and_at_a_server() {
    let (folder, mut server) = (tempfile::tempdir().unwrap(), Server::start().await);
    let database = folder.path().join("headway.db").to_str().unwrap().to_owned();
    let here = story(Place(&["--database", &database]), folder.path());
    server.close_gate().await;
    let key = written(folder.path(), "key", server.key.clone().unwrap().as_bytes());
    let there = story(Place(&["--server", &server.url, "--key-file", &key]), folder.path());
    for (here, there) in here.iter().zip(&there) {
        assert_eq!(here, there);
    }
    // And what they answer is what the interface does.
    let version = server.get("/v1/models/m/versions/2").await.expect(200).body;
    assert_eq!(timeless(version), here[6]["version"]);
    let kept = server.stop().await;
    // Whoever has the file needs no key, and a file that has a server is its alone.
    let kept = kept.path().join("headway.db").to_str().unwrap().to_owned();
    let listed = Place(&["--database", &kept]).run(&["versions", "--model", "m", "--json"]).json();
    assert_eq!(timeless(listed), here[5]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_person_reads_plain_tables() {
    let (folder, server) = (tempfile::tempdir().unwrap(), Server::start().await);
    let place = Place(&["--server", &server.url]);
    let lines = |arguments: &[&str]| {
        let said = place.run(arguments).done();
        assert!(!said.contains('\u{1b}'), "no colours in a pipe: {said:?}");
        said.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect::<Vec<_>>()
    };
    assert!(lines(&["versions"])[0].contains("`headway train` learns"));
    let file = written(folder.path(), "e.ndjson", &ndjson(&events("e", 12, 16.0)));
    lines(&["import", &file, "--regime", "fast"]);
    let trained = lines(&["train"]);
    assert_eq!(trained[0], "version 1 of default has learned fast traffic; promoted: the policy is auto");
    assert_eq!(trained[2], "DRIVER REGIME EVENTS SPACING_MSE_M2 SPEED_MSE COLLISIONS_% FORGETTING");
    assert!(trained[3].starts_with("v1 fast 3 "), "{trained:?}");
    let versions = lines(&["versions"]);
    assert!(versions[1].starts_with("1 1 fast – ewc 1.00 live,head 20"), "{versions:?}");
    // What waits of two regimes is learned in turn.
    for (regime, speed) in [("slow", 6.0), ("jam", 3.0)] {
        let file = written(folder.path(), "other.ndjson", &ndjson(&events(regime, 12, speed)));
        lines(&["import", &file, "--regime", regime]);
    }
    let trained = lines(&["train"]);
    let learned: Vec<_> = trained.iter().filter(|line| line.starts_with("version ")).collect();
    assert!(learned[0].starts_with("version 2 of default has learned slow traffic"), "{trained:?}");
    assert!(learned[1].starts_with("version 3 of default has learned jam traffic"), "{trained:?}");
    let window = written(folder.path(), "window.json", window(5, 9.0).to_string().as_bytes());
    let predicted = lines(&["predict", &window]);
    assert_eq!((predicted[0].as_str(), predicted.len()), ("version 3 of default", 4));
    assert_eq!(lines(&["models", "list"])[1].split(' ').take(4).collect::<Vec<_>>(), ["default", "ewc", "3", "3"]);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_command_that_cannot_do_its_work_says_why_and_what_helps() {
    let (folder, server) = (tempfile::tempdir().unwrap(), Server::start().await);
    let there = Place(&["--server", &server.url]);
    let absent = folder.path().join("absent.db").to_str().unwrap().to_owned();
    let owned = server.directory.path().join("headway.db").to_str().unwrap().to_owned();
    let words = written(folder.path(), "words.json", b"no json");
    for (place, arguments, why) in [
        (there, &["train"][..], "Upload events first"),
        (there, &["versions", "--model", "nobody"], "no model is called \"nobody\""),
        (there, &["promote", "3", "--reason", "x"], "GET …/versions lists the model's versions."),
        (there, &["predict", &words], "is not JSON"),
        (there, &["predict", "absent.json"], "cannot read absent.json"),
        (there, &["evaluate", &words, "--references", "idm,walker"], "walker"),
        (Place(&["--database", &absent]), &["versions"], "there is no database"),
        (Place(&["--database", &owned]), &["train"], "--server URL"),
        (Place(&["--server", "http://127.0.0.1:1"]), &["versions"], "does a server listen there?"),
        (Place(&["--database", &owned]), &["train", "--detach"], "--server"),
    ] {
        let said = place.run(arguments).refused();
        assert!(said.contains(why), "{arguments:?}: {said}");
    }
    assert!(!Path::new(&absent).exists());
    server.stop().await;
}

#[test]
fn learning_that_is_interrupted_goes_on_with_the_next_command() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("headway.db").to_str().unwrap().to_owned();
    let place = Place(&["--database", &database]);
    let file = written(folder.path(), "e.ndjson", &ndjson(&events("e", 12, 16.0)));
    place.run(&["import", &file, "--regime", "fast"]).done();
    let mut command = Command::new(env!("CARGO_BIN_EXE_headway"));
    command.envs(VARIABLES).env("HEADWAY_SERVER__PROGRESS_INTERVAL_S", "0.05").args([
        "train",
        "--set",
        "epochs=1000",
        "--database",
        &database,
    ]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    assert!(line.contains("epoch "), "{line}");
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert!(!child.wait().unwrap().success());
    let mut rest = String::new();
    said.read_to_string(&mut rest).unwrap();
    assert!(rest.contains("interrupted") && rest.contains("headway train"), "{rest}");
    assert!(place.run(&["versions"]).done().contains("has learned nothing yet"));
    let trained = place.run(&["train", "--json"]).json();
    assert_eq!(trained["trained"][0]["version"]["settings"]["epochs"], 1000);
    assert!(place.run(&["train"]).refused().contains("Upload events first"));
}

#[test]
fn shells_and_man_know_every_command() {
    let nowhere = Place(&[]);
    let help = nowhere.run(&["--help"]).done();
    let commands = help.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap();
    let names = commands.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names: Vec<_> =
        names.filter_map(|line| line.split_whitespace().next()).filter(|&name| name != "help").collect();
    assert!(names.contains(&"serve") && names.contains(&"rollback") && names.len() > 20, "{names:?}");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = nowhere.run(&["completions", shell]).done();
        assert!(names.iter().all(|name| script.contains(name)), "{shell}");
    }
    let folder = tempfile::tempdir().unwrap();
    nowhere.run(&["manual", "--out", folder.path().to_str().unwrap()]).done();
    for name in names {
        let page = std::fs::read_to_string(folder.path().join(format!("headway-{name}.1"))).unwrap();
        assert!(page.contains(".SH SYNOPSIS") && page.contains(".SH OPTIONS"), "{name}");
    }
    assert!(nowhere.run(&["manual"]).done().contains("headway"));
}

#[test]
fn traffic_is_made_up_alike_by_the_same_seed_and_is_taken_as_it_is() {
    let (folder, nowhere) = (tempfile::tempdir().unwrap(), Place(&[]));
    let made = |seed: &str| nowhere.run(&["generate", "slow", "--events", "3", "--seed", seed]).done();
    assert_eq!(made("7"), made("7"));
    assert_ne!(made("7"), made("8"));
    let database = folder.path().join("headway.db");
    let file = written(folder.path(), "slow.csv", made("7").as_bytes());
    let taken =
        Place(&["--database", database.to_str().unwrap()]).run(&["import", &file, "--regime", "slow", "--json"]).json();
    let receipt = &taken["files"][0]["receipt"];
    assert_eq!((&receipt["accepted"], &receipt["rejected_count"]), (&json!(3), &json!(0)), "{taken}");
    assert!(nowhere.run(&["generate", "slow", "--events", "0"]).refused().contains("1..=100000"));
}
